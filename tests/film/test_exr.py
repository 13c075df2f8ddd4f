import struct
import warnings
from dataclasses import fields

import numpy as np
import OpenEXR
import pytest

from skinrender.errors import InputError, RunError
from skinrender.film.exr import read_exr, write_exr
from skinrender.film.spectral_image import RgbImage, SpectralImage


@pytest.mark.parametrize("bands", [None, [450], [380.5, 600, 1064.25]])
def test_round_trip(tmp_path, make_image, bands):
    image = make_image(bands, lamp="E")
    write_exr(tmp_path / "beam.exr", image)
    again = read_exr(tmp_path / "beam.exr")
    assert isinstance(again, SpectralImage)
    for field in fields(SpectralImage):
        got, expected = getattr(again, field.name), getattr(image, field.name)
        if isinstance(expected, np.ndarray):
            assert got.dtype == expected.dtype
            assert np.allclose(got, expected, rtol=3e-7, atol=0), field.name
        else:
            assert got == expected


def test_channels_and_units_of_the_file(tmp_path, make_image):
    image = make_image()
    write_exr(tmp_path / "beam.exr", image, reflectance=True)
    with OpenEXR.File(str(tmp_path / "beam.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels.copy() for name, channel in file.channels().items()}
        header = dict(file.header())
        assert len(file.parts) == 1
    assert header["spectralLayoutVersion"] == "1.0"
    assert header["emissiveUnits"] == "W.m^-2.sr^-1"
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION
    assert len(channels) == 2 * 81 + 3 + 5
    assert {pixels.dtype for pixels in channels.values()} == {np.dtype("float32")}
    assert np.allclose(channels["S0.550,000000nm"], 1e6 * image.radiance[..., 34])
    assert np.allclose(channels["T.550,000000nm"], image.radiance_factor()[..., 34])
    assert np.allclose(np.stack([channels[c] for c in "RGB"], -1), image.rgb(), atol=1e-6)
    for part in ("surface", "single", "multiple", "stderr"):
        assert np.array_equal(channels[f"{part}.Y"], getattr(image, f"{part}_Y"))


def test_colour_science_reads_it_as_a_spectral_image(tmp_path, make_image):
    pytest.importorskip("OpenImageIO", reason="colour-science reads EXR by OpenImageIO")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    image = make_image()
    write_exr(tmp_path / "beam.exr", image)
    components = colour.read_spectral_image_Fichet2021(str(tmp_path / "beam.exr"))
    wavelength_nm, radiance = components["S0"]
    assert np.allclose(wavelength_nm, image.wavelength_nm)
    assert np.allclose(radiance, 1e6 * image.radiance, rtol=1e-6)


def test_same_image_same_bytes(tmp_path, make_image):
    for name in ("a.exr", "b.exr"):
        write_exr(tmp_path / name, make_image())
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_foreign_pictures_give_rgb(tmp_path):
    rng = np.random.default_rng(3)
    rgb = rng.random((5, 4, 3)).astype(np.float16)
    write_foreign(tmp_path / "rgb.exr", {name: rgb[..., i].copy() for i, name in enumerate("RGB")})
    image = read_exr(tmp_path / "rgb.exr")
    assert isinstance(image, RgbImage)
    assert np.array_equal(image.rgb(), rgb.astype(np.float32))
    grey = rng.random((5, 4)).astype(np.float32)
    write_foreign(tmp_path / "grey.exr", {"Y": grey})
    assert np.allclose(read_exr(tmp_path / "grey.exr").y(), grey)
    assert read_exr(tmp_path / "grey.exr").provenance == {}


def test_pictures_without_color_are_refused(tmp_path):
    write_foreign(tmp_path / "depth.exr", {"Z": np.zeros((5, 4), np.float32)})
    with pytest.raises(InputError, match=r"depth\.exr.*Z"):
        read_exr(tmp_path / "depth.exr")


def write_foreign(path, channels):
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def test_missing_files_folders_and_other_formats(tmp_path):
    (tmp_path / "text.exr").write_text("not a picture")
    (tmp_path / "empty.exr").touch()
    for name, message in (
        ("absent.exr", "No such file"),
        (".", "cannot read"),
        ("text.exr", "not an OpenEXR"),
        ("empty.exr", "not an OpenEXR"),
    ):
        with pytest.raises(InputError, match=message):
            read_exr(tmp_path / name)


def test_truncated_at_any_place_is_told(tmp_path, make_image, capsys):
    write_exr(tmp_path / "whole.exr", make_image(size=(40, 12)))
    whole = (tmp_path / "whole.exr").read_bytes()
    part = tmp_path / "part.exr"
    for length in (5, 100, 3000, len(whole) // 2, len(whole) - 1):
        part.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"part\.exr: the file is truncated or damaged"):
            read_exr(part)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("window", [(0, 0, 2**20, 2**20), (0, 0, 2**31 - 2, 2**31 - 2), (10, 10, 0, 0)])
def test_absurd_windows_are_refused_before_memory_is_taken(tmp_path, make_image, window):
    path = tmp_path / "absurd.exr"
    write_exr(path, make_image())
    content = bytearray(path.read_bytes())
    at = content.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    content[at : at + 16] = struct.pack("<4i", *window)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"absurd\.exr"):
        read_exr(path)


def test_damaged_attribute_is_told(tmp_path, make_image, monkeypatch):
    monkeypatch.setattr("skinrender.film.exr._checksum", lambda *_: "forged")
    path = tmp_path / "beam.exr"
    write_exr(path, make_image())
    path.write_bytes(path.read_bytes().replace(b'{"exposure"', b'}"exposure"'))
    with pytest.raises(InputError, match="skinrender:film is not JSON"):
        read_exr(path)


def test_light_of_two_spectra_is_a_programming_error(tmp_path, make_image):
    image = make_image()
    image.irradiance[0, 0, 0] *= 2
    with pytest.raises(ValueError, match="same spectrum"):
        write_exr(tmp_path / "beam.exr", image)
    assert not list(tmp_path.iterdir())


def test_light_beyond_float32_is_told(tmp_path, make_image):
    image = make_image()
    image.irradiance[:] *= np.float32(1e35)
    with pytest.raises(RunError, match="stronger than a picture"):
        write_exr(tmp_path / "beam.exr", image)
    assert not list(tmp_path.iterdir())


def test_unwritable_place_leaves_nothing(tmp_path, make_image):
    with pytest.raises(RunError, match="absent"):
        write_exr(tmp_path / "absent" / "beam.exr", make_image())
    (tmp_path / "taken.exr").mkdir()
    with pytest.raises(RunError, match=r"taken\.exr"):
        write_exr(tmp_path / "taken.exr", make_image())
    assert [path.name for path in tmp_path.iterdir()] == ["taken.exr"]
