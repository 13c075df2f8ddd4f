"""The map's file: what is written is what is read, and nothing else is accepted."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.npz import read_npz, write_npz
from skinrender.photonmap.photon_map import open_map
from skinrender.photonmap.store import (
    MapHeader,
    read_header,
    read_round,
    round_path,
    write_header,
    write_map,
    write_round,
)
from skinrender.transport import tally

STORED = np.array([[3, 0], [1, 2], [0, 0], [4, 5]])


def header(**changes) -> MapHeader:
    plain = MapHeader(
        wavelength_nm=np.array([450.0, 650.0]),
        power_aimed_per_band=np.array([2.0, 6.0]),
        bounds_mm=np.array([[0.0, 0.0, -0.1], [10.0, 10.0, 4.0]]),
        layer_name=("epidermis", "dermis"),
        provenance={"seed": 1, "light": {"kind": "point"}},
        stored_wanted=12,
    )
    return replace(plain, **changes)


def walked(index: int) -> SimpleNamespace:
    rng = np.random.default_rng(index)
    stored = STORED[index]
    return SimpleNamespace(
        index=index,
        emitted=np.array([5, 10]),
        stored_per_band=stored,
        tallies=rng.integers(0, 9, (2, tally.columns(2))),
        position=rng.uniform(0, 4, (stored.sum(), 3)).astype(np.float32),
        direction=rng.integers(0, 65536, (stored.sum(), 2)).astype(np.uint16),
    )


@pytest.fixture
def path(tmp_path):
    return made(tmp_path, header())


def made(folder, head):
    counts = [write_round(folder, head.key, walked(index)) for index in range(4)]
    write_map(folder / "photons.npz", head, counts, [round_path(folder, index) for index in range(4)])
    return folder / "photons.npz"


def rewritten(path, **changes):
    members = {name: array for name, array in read_npz(path, mmap=False).items()}
    for name, value in changes.items():
        if value is None:
            del members[name]
        else:
            members[name] = value
    write_npz(path, members)
    return path


def test_map_holds_the_rounds_one_after_the_other(path):
    photon_map = open_map(path, check_photons=True)
    assert len(photon_map) == 15 and photon_map.rounds == 4 and photon_map.bands == 2
    for index in range(4):
        part = photon_map.round_slice(index)
        assert np.array_equal(photon_map.position[part], walked(index).position)
        assert np.array_equal(photon_map.direction[part], walked(index).direction)
        assert np.array_equal(photon_map.tallies[index], walked(index).tallies)
        for band in range(2):
            assert photon_map.band[photon_map.band_slice(index, band)].tolist() == [band] * STORED[index, band]


def test_power_is_shared_by_the_histories_emitted_in_the_band(path):
    photon_map = open_map(path)
    assert photon_map.emitted_per_band.tolist() == [20, 40]
    assert photon_map.power_per_band.tolist() == [2.0 / 20, 6.0 / 40]


def test_file_has_seventeen_bytes_a_photon_that_numpy_reads(path):
    with np.load(path, allow_pickle=False) as members:
        photons = sum(members[name].nbytes for name in ("position", "direction", "band"))
        assert photons == 17 * 15
        assert members["wavelength_nm"].tolist() == [450.0, 650.0]


def test_keep_probability_comes_back(tmp_path):
    keep = np.array([[1.0, 0.5], [1.0, 0.25]], np.float32)
    photon_map = open_map(made(tmp_path, header(keep_probability=keep, depth_edges_mm=np.array([0.0, 1.0, 4.0]))))
    assert np.array_equal(photon_map.keep_probability, keep)
    assert open_map(path_without_table(tmp_path)).keep_probability is None


def path_without_table(tmp_path):
    folder = tmp_path / "plain"
    folder.mkdir()
    return made(folder, header())


def test_provenance_is_compared_key_by_key(path):
    assert open_map(path, expected={"seed": 1}).provenance["light"] == {"kind": "point"}
    with pytest.raises(InputError, match="differs in: seed, volume"):
        open_map(path, expected={"seed": 2, "volume": "x", "light": {"kind": "point"}})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format_version": np.int64(99)}, "format_version"),
        ({"format_version": None}, "format_version"),
        ({"position": None}, "position"),
        ({"provenance": np.array("{")}, "not a photon map"),
        ({"provenance": np.array("[]")}, "provenance"),
        ({"direction": np.zeros((15, 2), np.uint8)}, "direction"),
        ({"band": np.zeros(14, np.uint8)}, "count"),
        ({"round_band_start": np.array([0, 3, 2, 4, 6, 6, 6, 10, 15])}, "round_band_start"),
        ({"round_band_start": np.array([0, 3, 15, 15])}, "round_band_start"),
        ({"round_band_start": np.zeros(0, np.int64)}, "round_band_start"),
        ({"power_per_band": np.array([1.0, np.nan])}, "power_per_band is not finite"),
        ({"power_per_band": np.array([1, 2])}, "power_per_band"),
        ({"wavelength_nm": np.zeros(0)}, "0 bands"),
        ({"bounds_mm": np.zeros(3)}, "bounds_mm"),
        ({"tallies": np.zeros(3, np.int64)}, "tallies"),
        ({"keep_probability": np.full((2, 2), 2, np.float32), "depth_edges_mm": np.arange(3.0)}, "probability"),
        ({"keep_probability": np.ones((2, 2), np.float32)}, "without each other"),
    ],
)
def test_maps_of_the_wrong_form_are_refused(path, changes, message):
    with pytest.raises(InputError, match=message):
        open_map(rewritten(path, **changes))


def test_photons_are_looked_at_on_request(path):
    sound = np.array(open_map(path).position)
    for wrong in (np.nan, np.inf, 11.0):
        position = sound.copy()
        position[7, 1] = wrong
        with pytest.raises(InputError, match="position"):
            open_map(rewritten(path, position=position), check_photons=True)
    rewritten(path, position=sound)
    band = open_map(path).band.copy()
    band[0] = 1
    with pytest.raises(InputError, match="order"):
        open_map(rewritten(path, band=band), check_photons=True)


def test_round_of_another_run_is_refused(tmp_path):
    write_round(tmp_path, "one", walked(1))
    assert read_round(round_path(tmp_path, 1), "one").stored == 3
    with pytest.raises(InputError, match="another run"):
        read_round(round_path(tmp_path, 1), "two")


def test_header_comes_back_with_its_key(tmp_path):
    write_header(tmp_path / "run.npz", header())
    back = read_header(tmp_path / "run.npz")
    assert back.key == header().key and back.stored_wanted == 12 and back.layer_name == ("epidermis", "dermis")
    rewritten(tmp_path / "run.npz", format_version=np.int64(0))
    with pytest.raises(InputError, match="format_version"):
        read_header(tmp_path / "run.npz")
