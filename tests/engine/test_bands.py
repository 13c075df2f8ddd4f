"""A picture estimated in parts of some bands is the picture."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from skinrender.engine import bands as bands_module
from skinrender.engine.bands import BandsErrand, ShowBands, parts_of, stored_per_band
from skinrender.engine.estimate import open_view
from skinrender.engine.identity import file_hash
from skinrender.engine.recipe import VolumeFile
from skinrender.engine.trace import trace
from skinrender.estimate.stream import sample_depths
from skinrender.photonmap.photon_map import open_map
from skinrender.scene import make_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import load_volume, save_volume

SKIN = {
    "patch": {"size_mm": [2, 2], "columns": [40, 40]},
    "bands_nm": [420, 500, 580, 660],
    "skin": {"site": "forearm"},
    "light": {"kind": "point", "height_mm": 100},
    "camera": {"kind": "orthographic", "pixels": [12, 10]},
    "photons": {"stored": 2e5},
}


@pytest.fixture(scope="module")
def traced(tmp_path_factory):
    """Scene, folder with volume and map."""
    folder, scene = tmp_path_factory.mktemp("bands"), make_scene(SKIN)
    save_volume(build_volume(scene), folder / "volume.npz")
    trace(scene, folder / "volume.npz", folder, workers=1, progress=False)
    return scene, folder


def test_parts_hold_their_share_of_the_photons(traced, monkeypatch):
    photon_map = open_map(traced[1] / "photons.npz")
    stored = stored_per_band(photon_map)
    assert stored.sum() == len(photon_map) and [part.tolist() for part in parts_of(photon_map)] == [[0, 1, 2, 3]]
    monkeypatch.setattr(bands_module, "PART_PHOTONS", int(stored[0] + stored[1]))
    parts = parts_of(photon_map)
    assert np.concatenate(parts).tolist() == [0, 1, 2, 3] and parts[0].tolist() == [0, 1]
    monkeypatch.setattr(bands_module, "PART_PHOTONS", 1)
    assert [part.tolist() for part in parts_of(photon_map)] == [[0], [1], [2], [3]]


def test_a_map_of_some_bands_holds_their_photons_alone(traced):
    whole = open_map(traced[1] / "photons.npz")
    part = whole.of_bands(np.array([1, 3]))
    assert len(part) == stored_per_band(whole)[[1, 3]].sum() and (part.rounds, part.bands) == (
        whole.rounds,
        whole.bands,
    )
    for index in (0, whole.rounds - 1):
        for band in range(whole.bands):
            held, wanted = part.band_slice(index, band), whole.band_slice(index, band)
            if band in (1, 3):
                assert np.array_equal(part.position[held], whole.position[wanted])
                assert np.array_equal(part.direction[held], whole.direction[wanted]) and (part.band[held] == band).all()
            else:
                assert held.start == held.stop


@pytest.mark.parametrize("method", ["beam", "point", "reference"])
def test_parts_that_traveled_make_the_same_picture(traced, method):
    """Each part as a worker elsewhere does it, on photons that were sent there."""
    scene, folder = traced
    volume, photon_map = load_volume(folder / "volume.npz"), open_map(folder / "photons.npz")
    view = open_view(scene, volume, photon_map.rounds, method=method, threads=2)
    whole = view.scattered(photon_map, progress=False)
    file = VolumeFile(folder / "volume.npz", file_hash(folder / "volume.npz"))
    parts = (np.array([0]), np.array([1, 2]), np.array([3]))
    work = ShowBands(scene, method, view.gather_count, file, photon_map, sample_depths(photon_map), parts)
    lights = []
    for index in range(len(parts)):
        errand = pickle.loads(pickle.dumps(work.errand(index)))
        assert isinstance(errand, BandsErrand) and work.finished(index) is None
        lights.append(work.keep(pickle.loads(pickle.dumps(errand(folder / "volume.npz")))))
    light = view.joined(lights, photon_map.rounds)
    assert np.array_equal(light.radiance, whole.radiance) and whole.radiance.any()
    np.testing.assert_allclose(light.batch_y, whole.batch_y, rtol=1e-4, atol=1e-6 * whole.batch_y.max())
    np.testing.assert_allclose(light.batch_radiance, whole.batch_radiance, rtol=1e-9)
    assert light.gathered == pytest.approx(whole.gathered) and light.remaining.keys() == whole.remaining.keys()
    for name, pair in whole.remaining.items():
        assert light.remaining[name] == pytest.approx(pair, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("method", ["beam", "point"])
def test_the_picture_is_the_same_for_any_number_of_threads(traced, method):
    scene, folder = traced
    volume, photon_map = load_volume(folder / "volume.npz"), open_map(folder / "photons.npz")
    first, second = (
        open_view(scene, volume, photon_map.rounds, method=method, threads=threads).scattered(
            photon_map, progress=False
        )
        for threads in (1, 3)
    )
    assert np.array_equal(first.radiance, second.radiance) and np.array_equal(first.batch_y, second.batch_y)
