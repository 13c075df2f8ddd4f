"""MCX input: keys, labels and sources; read by pmcx and run by pmcxcl where they are installed."""

from __future__ import annotations

import base64
import json
import math
import zlib

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.export.mcx import cube_edge, write_mcx
from tests.volumes import Layer, beam, lamp, sky, slab_volume

TWO = (Layer(0.2, 2.0, 20.0, 0.8), Layer(0.3, 0.5, 10.0, 0.6))


def written(path, volume, light, **options):
    options = {"edge_mm": 0.1, "photons": 1000, "seed": 3} | options
    done = write_mcx(volume, light, 550.0, path / "mcx.json", **options)
    return done, json.loads(done.path.read_text(encoding="utf-8"))


def decoded(shapes: dict) -> np.ndarray:
    data = zlib.decompress(base64.b64decode(shapes["_ArrayZipData_"]))
    return np.frombuffer(data, shapes["_ArrayType_"]).reshape(shapes["_ArraySize_"])


def odd_volume():
    """Two by three columns, one of which differs."""
    volume = slab_volume(TWO, size=(0.2, 0.3), columns=(2, 3))
    volume.palette_index[1, 2, 0] = 2
    return volume


def test_labels_stand_for_the_coefficients_of_their_voxels(tmp_path):
    done, document = written(tmp_path, odd_volume(), beam(position=(0.1, 0.15)))
    label = decoded(document["Shapes"])
    assert label.shape == tuple(document["Domain"]["Dim"]) == (2, 3, 5)
    assert document["Domain"]["LengthUnit"] == pytest.approx(0.1)
    mu_a = np.array([medium["mua"] for medium in document["Domain"]["Media"]])[label]
    assert mu_a[0, 0] == pytest.approx([2.0, 2.0, 0.5, 0.5, 0.5])
    assert mu_a[1, 2] == pytest.approx(0.5)
    assert done.label_error == 0.0
    assert done.notes == ()


@pytest.mark.parametrize(("sides", "below", "flags"), [
    ("periodic", None, "cc_cca"), ("open", 1.0, "aa_aar"), ("open", 1.45, "aa_aaa"), ("dielectric", 1.0, "rr_rrr"),
])  # fmt: skip
def test_boundaries(tmp_path, sides, below, flags):
    _, document = written(tmp_path, slab_volume(TWO, sides=sides, below=below), sky())
    session = document["Session"]
    assert (session["BCFlags"], session["DoMismatch"], session["DoSpecular"]) == (flags, 1, 1)


def test_point_light_spreads_from_its_place(tmp_path):
    volume = slab_volume(TWO, outside=1.4)
    _, document = written(tmp_path, volume, lamp(0.3, 0.5, 2.0))
    source = document["Optode"]["Source"]
    center = np.array([5.0, 5.0, 0.0])
    focus = center + source["Dir"][3] * np.array(source["Dir"][:3])
    assert focus == pytest.approx([3.0, 5.0, -20.0])
    pattern = np.reshape(source["Pattern"]["Data"], (32, 32))
    x = (np.arange(32) + 0.5) / 32
    cubed = (np.hypot(np.hypot(x - 0.3, x[:, None] - 0.5), 2.0)) ** -3
    assert pattern == pytest.approx(cubed / cubed.max())


def test_disc_and_pencil_meet_the_mean_plane_where_they_should(tmp_path):
    volume = slab_volume(TWO)
    for radius in (0.0, 0.1):
        _, document = written(tmp_path, volume, beam(30.0, radius=radius, position=(0.4, 0.5)))
        source = document["Optode"]["Source"]
        position, direction = np.array(source["Pos"]), np.array(source["Dir"][:3])
        assert position[2] + math.sin(math.radians(30.0)) * 10 * radius < 0.0
        assert (position - direction * position[2] / direction[2])[:2] == pytest.approx([4.0, 5.0])


def test_default_cubes_fill_the_block():
    volume = slab_volume((Layer(3.0, 1, 1),), size=(10.0, 10.0))
    edge = cube_edge(volume)
    assert 3.0 / edge == pytest.approx(round(3.0 / edge))
    assert 10.0 / edge == pytest.approx(round(10.0 / edge))


def test_cubes_that_do_not_fill_the_volume_are_told(tmp_path):
    done, _ = written(tmp_path, slab_volume((Layer(math.pi / 10, 1, 1),)), sky())
    assert any("do not fill" in note for note in done.notes)


def test_unknown_band_writes_nothing(tmp_path):
    with pytest.raises(InputError, match="no band"):
        write_mcx(slab_volume(TWO), sky(), 600.0, tmp_path / "x.json", edge_mm=None, photons=1, seed=1)
    assert not list(tmp_path.iterdir())


def test_pmcx_reads_the_volume_as_it_is(tmp_path):
    pmcx = pytest.importorskip("pmcx", reason="pmcx is not installed (extra interop)")
    pytest.importorskip("jdata", reason="jdata is not installed (extra interop)")
    done, document = written(tmp_path, odd_volume(), sky())
    cfg = pmcx.json2mcx(str(done.path))
    assert np.array_equal(cfg["vol"], decoded(document["Shapes"]))
    assert cfg["srcdir"][3] == -math.inf


def test_pmcxcl_absorbs_what_the_formula_says(tmp_path):
    pmcx = pytest.importorskip("pmcx", reason="pmcx is not installed (extra interop)")
    pmcxcl = pytest.importorskip("pmcxcl", reason="pmcxcl is not installed (extra interop)")
    pytest.importorskip("jdata", reason="jdata is not installed (extra interop)")
    try:
        pmcxcl.gpuinfo()
    except RuntimeError as error:
        pytest.skip(f"no OpenCL device: {error}")
    absorbers = (Layer(0.2, 2.0, 0.0), Layer(0.3, 0.5, 0.0))
    volume = slab_volume(absorbers, outside=1.4)
    done, _ = written(tmp_path, volume, beam())
    energy = pmcxcl.run(pmcx.json2mcx(str(done.path)))["flux"].sum(axis=(0, 1, 3))
    depth = np.array([0.0, 0.2, 0.4, 0.45, 0.5, 0.55])  # optical depth of the cubes' planes
    assert energy == pytest.approx(-np.diff(np.exp(-depth)), rel=1e-4)
