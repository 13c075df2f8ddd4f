"""The photon pass over real scenes: the same photons whoever walks them, when and how often."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from skinrender.engine.trace import trace
from skinrender.errors import RunError
from skinrender.photonmap import photon_pass as photon_pass_module
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_map import open_map
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.scene import Scene, make_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import load_volume, save_volume
from skinrender.transport import tally
from tests.volumes import Layer, assert_energy, beam, slab_volume

BANDS = [450, 550, 650]


def skin_scene(folder: Path, **keys) -> Scene:
    gray = np.full((16, 16), 255, np.uint8)
    gray[4:12, 4:12] = 100
    Image.fromarray(gray).save(folder / "macule.png")
    scene = {
        "patch": {"size_mm": [1, 1], "columns": [16, 16]},
        "bands_nm": BANDS,
        "skin": {},
        "lesions": [{"kind": "epidermal", "pattern": "macule.png"}],
        "light": {"kind": "point", "height_mm": 30, "spectrum": "A"},
        "photons": {"stored": 4000, "seed": 3},
    }
    return make_scene(scene | keys, source_dir=folder)


@pytest.fixture(scope="module")
def skin(tmp_path_factory) -> tuple[Scene, Path]:
    """A tiny scene of skin with relief and macule, and its volume's file."""
    folder = tmp_path_factory.mktemp("skin")
    scene = skin_scene(folder)
    save_volume(build_volume(scene), folder / "volume.npz")
    return scene, folder / "volume.npz"


@pytest.fixture
def photon_pass(skin) -> PhotonPass:
    return pass_of(*skin)


def pass_of(scene: Scene, path: Path) -> PhotonPass:
    return PhotonPass(load_volume(path), light_from_scene(scene), scene.photons.seed, roulette=scene.photons.roulette)


def content(one):
    return one.tallies.tobytes(), one.position.tobytes(), one.direction.tobytes(), one.stored_per_band.tobytes()


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_photons_of_skin_lie_in_the_volume_and_energy_is_exact(photon_pass):
    one = photon_pass.walk(0, np.array([300, 400, 500]), True)
    assert_energy(one, len(photon_pass.layer_names))
    low, high = photon_pass.volume.bounds_mm
    assert len(one.position) > 1000
    assert np.all((one.position >= low.astype(np.float32)) & (one.position <= high.astype(np.float32)))


def test_rounds_walked_in_any_order_are_the_same(skin):
    histories = np.array([100, 100, 100])
    first, second = pass_of(*skin), pass_of(*skin)
    forward = [content(first.walk(index, histories, True)) for index in range(4)]
    backward = [content(second.walk(index, histories, True)) for index in (3, 2, 1, 0)]
    assert forward == backward[::-1]
    assert len(set(forward)) == 4


def photons(position, direction):
    """Photons as bytes, sorted."""
    return sorted(bytes(p) + bytes(d) for p, d in zip(position, direction))


def test_the_photons_of_a_band_do_not_depend_on_the_other_bands(photon_pass):
    """But for their order: the bands of a round share a block."""
    all_bands = photon_pass.walk(1, np.array([120, 120, 120]), True)
    starts = np.concatenate([[0], np.cumsum(all_bands.stored_per_band)])
    for band in range(3):
        only = photon_pass.walk(1, np.where(np.arange(3) == band, 120, 0), True)
        part = slice(starts[band], starts[band + 1])
        assert photons(only.position, only.direction) == photons(all_bands.position[part], all_bands.direction[part])
        assert np.array_equal(only.tallies[band], all_bands.tallies[band])
        assert not np.delete(only.tallies, band, axis=0).any()
        assert np.delete(only.stored_per_band, band).tolist() == [0, 0]


def test_each_band_emits_exactly_its_share(photon_pass):
    histories = np.array([70, 0, 130])
    one = photon_pass.walk(0, histories, True)
    assert one.emitted.tolist() == one.tallies[:, tally.EMITTED].tolist() == histories.tolist()


def test_seeds_give_other_photons(skin):
    scene, path = skin
    passes = [PhotonPass(load_volume(path), light_from_scene(scene), seed) for seed in (1, 2)]
    one, other = (p.walk(0, np.array([50, 50, 50]), True) for p in passes)
    assert content(one) != content(other)


def test_bands_have_their_own_numbers(photon_pass):
    """Where nothing depends on the wavelength, bands are still independent."""
    one = photon_pass.walk(0, np.array([40, 40, 40]), True)
    a, b = (one.position[start : start + 20] for start in (0, one.stored_per_band[0]))
    assert not np.isin(a[:, 0], b[:, 0]).any()


def test_the_power_of_a_photon_is_its_bands_power_over_the_histories(skin, tmp_path):
    scene, path = skin
    trace(scene, path, tmp_path, workers=1, progress=False)
    found = open_map(tmp_path / "photons.npz")
    assert len(found.position) >= scene.photons.stored
    power = light_from_scene(scene).power_aimed_per_band(scene.patch.size_mm)
    assert found.power_per_band * found.emitted_per_band == pytest.approx(power)


def traced(skin, folder: Path, workers: int) -> str:
    scene, path = skin
    trace(scene, path, folder, workers=workers, progress=False)
    return digest(folder / "photons.npz")


def test_map_is_the_same_for_1_and_2_workers(skin, tmp_path):
    assert traced(skin, tmp_path / "one", 1) == traced(skin, tmp_path / "two", 2)


@pytest.mark.slow
def test_map_is_the_same_for_7_workers(skin, tmp_path):
    assert traced(skin, tmp_path / "one", 1) == traced(skin, tmp_path / "seven", 7)


WALK_IN_A_PROCESS = """
import hashlib, sys
import numpy as np
from skinrender.photonmap.light import CollimatedLight
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.skin.volume import load_volume

light = CollimatedLight(np.array([0.0, 0.0, 1.0]), np.ones(3), None, np.zeros(2))
one = PhotonPass(load_volume(sys.argv[1]), light, 9).walk(0, np.array([200, 200, 200]), True)
print(hashlib.sha256(one.position.tobytes() + one.direction.tobytes() + one.tallies.tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_compiled_and_cached_kernels_walk_the_same_photons(skin, tmp_path, repository):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", WALK_IN_A_PROCESS, str(skin[1])]
    digests = []
    for cached in (False, True):
        assert any(tmp_path.rglob("walk.walk*")) == cached
        walked = subprocess.run(command, env=environment, cwd=repository, capture_output=True, text=True, check=True)
        digests.append(walked.stdout)
    assert digests[0] == digests[1] and len(digests[0]) == 65


def test_a_walk_without_end_is_given_up(monkeypatch):
    """Light that cannot be absorbed in a slab of optical depth 1e5; looked at after a million passes."""
    monkeypatch.setattr(photon_pass_module, "ENDLESS", 1 << 10)
    volume = slab_volume([Layer(100.0, 0.0, 1000.0, 0.0, 1.0)])
    with pytest.raises(RunError, match="hardly ever end.*\n.*absorption"):
        PhotonPass(volume, beam(), 1).walk(0, np.array([5_000]), False)


def test_stiff_bands_are_walked_apart_and_stored_in_their_place():
    """Bands of 5, 3000 and 8 per mm: the middle one in double precision, as by itself; exits in the order of bands."""
    stacks = [slab_volume([Layer(5.0, 0.5, mu_s, 0.0)], planes=[20], below=1.0) for mu_s in (5.0, 3000.0, 8.0)]
    joined = {
        name: np.concatenate([getattr(stack, name) for stack in stacks], axis=-1)
        for name in ("mu_a", "mu_s", "g", "refractive_index", "n_outside", "n_below")
    }
    volume = replace(stacks[0], **joined, wavelength_nm=np.array([450.0, 550.0, 650.0]))
    light = replace(beam(20.0), irradiance=np.ones(3))
    photon_pass, histories, exits = PhotonPass(volume, light, 3), np.array([300, 40, 200]), []
    assert photon_pass._in_double.tolist() == [False, True, False]
    one = photon_pass.walk(1, histories, True, exits)
    starts = np.concatenate([[0], np.cumsum(one.stored_per_band)])
    for band in range(3):
        left = []
        alone = photon_pass.walk(1, np.where(np.arange(3) == band, histories, 0), True, left)
        part = slice(starts[band], starts[band + 1])
        assert one.stored_per_band[band] > 0 and np.array_equal(one.tallies[band], alone.tallies[band])
        assert photons(one.position[part], one.direction[part]) == photons(alone.position, alone.direction)
        assert np.array_equal(np.sort(exits[band], axis=0), np.sort(left[0], axis=0))
