"""Whole histories: energy in counts, what is stored, and that a history is its own affair."""

from __future__ import annotations

import re
from dataclasses import replace

import numba
import numpy as np
import pytest
from llvmlite import binding

from skinrender.photonmap import stored
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.skin.spline import evaluate_grid
from skinrender.transport import tally
from skinrender.transport.emission import LAMP_SIZE, emit
from skinrender.transport.entrance import meet_plane, pass_surface
from skinrender.transport.lanes import LANES
from skinrender.transport.move import fly, locate, wrap
from skinrender.transport.relief import look_around
from skinrender.transport.turn import collide
from tests.stats import assert_mean, assert_share
from tests.volumes import Layer, beam, furrow, lamp, sky, slab_volume, walk_rounds

SKIN = [Layer(0.1, 3.0, 40.0, 0.8, 1.5), Layer(0.5, 0.3, 20.0, 0.8, 1.4), Layer(0.5, 0.1, 5.0, 0.7, 1.45)]


def blotched(volume, seed=1):
    """The volume with voxels of its first layer replaced at random by those of its last."""
    index = volume.palette_index.copy()
    dark = np.random.default_rng(seed).random(index.shape) < 0.3
    index[dark & (index == 1)] = volume.palette_layer.size - 1
    return replace(volume, palette_index=index)


VOLUMES = {
    "one voxel": slab_volume([Layer(1.0, 0.5, 5.0)]),
    "matched": slab_volume([Layer(1.0, 0.5, 5.0, n=1.0)], below=1.0),
    "inner borders": slab_volume(SKIN, planes=[2, 5, 5]),
    "inner borders matched": slab_volume(SKIN, planes=[2, 5, 5], fresnel=False),
    "open": slab_volume(SKIN, sides="open"),
    "dielectric": slab_volume(SKIN, sides="dielectric", below=1.0),
    "relief": slab_volume(SKIN, planes=[4, 5, 5], surface=furrow(0.08), columns=(30, 30)),
    "relief, open": slab_volume(SKIN, planes=[4, 5, 5], surface=furrow(0.08), sides="open"),
    "relief, dielectric": slab_volume(SKIN, planes=[4, 5, 5], surface=furrow(0.08), sides="dielectric"),
    "lesion": blotched(slab_volume(SKIN, planes=[4, 5, 5], columns=(40, 24))),
    "albedo 0": slab_volume([Layer(0.5, 3.0, 0.0)]),
    "albedo 1": slab_volume([Layer(0.5, 0.0, 30.0, 0.9)], below=1.0),
    "clear layers": slab_volume([Layer(0.5, 0.0, 0.0, n=1.5), Layer(0.2, 1.0, 9.0), Layer(1.0, 0.0, 0.0)], below=1.0),
    "nothing": slab_volume([Layer(0.5, 0.0, 0.0, n=1.0)], below=1.0),
    "optically thick": slab_volume([Layer(10.0, 1.0, 900.0, 0.0)]),
    "ink": slab_volume([Layer(3.0, 0.1, 1.0), Layer(0.001, 5000.0, 5.0), Layer(3.0, 0.1, 1.0)]),
    "dense under thin air": slab_volume([Layer(1.0, 0.1, 5.0, n=1.0)], outside=1.5, below=1.5),
}


@pytest.mark.parametrize("name", VOLUMES)
def test_emitted_is_reflected_transmitted_gone_and_absorbed(name):
    volume = VOLUMES[name]
    layers = len(volume.layer_name) - 1
    for light in (beam(20.0, 30.0), lamp(), sky(), beam(89.9), beam(0.0, radius=0.0)):
        one = walk_rounds(PhotonPass(volume, light, 1), 400, store=True)[0]
        counts = one.tallies[0]
        absorbed, scattered = counts[tally.absorbed(layers)], counts[tally.scattered(layers)]
        assert not absorbed[volume.mu_a[1:, 0] == 0.0].any() and not scattered[volume.mu_s[1:, 0] == 0.0].any()
        assert counts[tally.SIDES] == 0 or volume.sides != "periodic"
        assert len(one.position) <= scattered.sum()


def test_albedo_0_and_1_absorb_all_and_nothing():
    thick = slab_volume([Layer(50.0, 10.0, 0.0, n=1.0)])
    assert walk_rounds(PhotonPass(thick, beam(), 1), 1000)[0].tallies[0, tally.PER_LAYER] == 1000
    white = slab_volume([Layer(0.5, 0.0, 50.0)], below=1.0)
    counts = walk_rounds(PhotonPass(white, sky(), 1), 1000)[0].tallies[0]
    assert counts[tally.PER_LAYER] == 0 and counts[tally.REFLECTED] + counts[tally.TRANSMITTED] == 1000


@pytest.mark.parametrize("histories", [0, 1, 2, LANES - 1, LANES, LANES + 1, 3 * LANES])
def test_any_number_of_histories(histories):
    one = PhotonPass(VOLUMES["inner borders"], beam(), 2).walk(3, np.array([histories]), True)
    assert one.tallies[0, tally.EMITTED] == histories
    assert (len(one.position) > 0) == (histories > 0)


def bits(one):
    """Photons as a set of bytes."""
    return {bytes(p) + bytes(d) for p, d in zip(one.position, one.direction)}


def test_photons_do_not_depend_on_the_size_of_the_buffer(monkeypatch):
    walks = []
    for least in (1 << 16, 1):
        monkeypatch.setattr(stored, "LEAST", least)
        walks.append(walk_rounds(PhotonPass(VOLUMES["inner borders"], beam(10.0), 5), 2000, store=True)[0])
    assert len(walks[0].position) > 20 * LANES
    assert np.array_equal(walks[0].position, walks[1].position) and np.array_equal(walks[0].tallies, walks[1].tallies)
    assert np.array_equal(walks[0].direction, walks[1].direction)


@pytest.mark.parametrize("name", ["inner borders", "relief", "ink"])
def test_a_history_is_the_same_alone_as_among_others(name):
    """Bit for bit, whatever lane it is in and whoever was there before; a pencil starts all in one point."""
    photon_pass = PhotonPass(VOLUMES[name], beam(10.0, radius=0.0), 5)
    together = photon_pass.walk(0, np.array([1200]), True)
    alone = [photon_pass.walk(history, np.array([1]), True) for history in range(0, 1200, 5)]
    assert bits(together) > set.union(*map(bits, alone)) and len(set.union(*map(bits, alone))) > 500


def test_storing_changes_no_history():
    photon_pass = PhotonPass(VOLUMES["lesion"], lamp(), 6)
    with_photons, without = (photon_pass.walk(2, np.array([3000]), store) for store in (True, False))
    assert np.array_equal(with_photons.tallies, without.tallies)
    assert len(with_photons.position) > 0 and len(without.position) == 0


def test_first_scattering_of_straight_light_is_not_stored():
    """Equal indices: all first scatterings are straight; a pencil's are stored, having no other estimate."""
    volume = slab_volume([Layer(1.0, 0.0, 3.0, n=1.0)], below=1.0)
    counts = walk_rounds(PhotonPass(volume, beam(), 7), 5000, store=True)[0]
    scattered, through = counts.tallies[0, tally.scattered(1)].sum(), counts.tallies[0, tally.TRANSMITTED_UNSCATTERED]
    assert len(counts.position) == scattered - (5000 - through)
    pencil = walk_rounds(PhotonPass(volume, beam(radius=0.0), 7), 5000, store=True)[0]
    assert len(pencil.position) == pencil.tallies[0, tally.scattered(1)].sum()


def test_first_scattering_after_an_inner_reflection_is_stored():
    """Hardly any scattering, and a bottom that reflects: what is stored was scattered on its way up."""
    volume = slab_volume([Layer(1.0, 0.0, 0.05, n=1.0)], below=3.0)
    one = walk_rounds(PhotonPass(volume, beam(), 8), 40_000, store=True)[0]
    reflected = ((3.0 - 1.0) / (3.0 + 1.0)) ** 2
    first_up = np.exp(-0.05) * reflected * -np.expm1(-0.05)
    assert 0.8 < len(one.position) / (40_000 * first_up) < 1.5


def test_a_pencil_meets_the_voxels_of_its_own_column():
    """Column [ix, iy] is x, y: four columns of different absorption, no scattering."""
    stack = slab_volume([Layer(0.2, mu_a, 0.0, n=1.0) for mu_a in (0.3, 1.0, 3.0, 0.7, 2.0)], size=(3.0, 2.0))
    index = np.array([[1, 2], [3, 4], [5, 1]], np.uint16)
    volume = replace(stack, palette_index=np.repeat(index[:, :, None], 5, axis=2))
    for ix, iy in np.ndindex(3, 2):
        photon_pass = PhotonPass(volume, beam(radius=0.0, position=(ix + 0.3, iy + 0.6)), 9)
        counts = walk_rounds(photon_pass, 5000)[0].tallies[0]
        assert_share(counts[tally.TRANSMITTED], 5000, np.exp(-volume.mu_a[index[ix, iy], 0]), 6)


def test_photons_lie_in_the_tissue():
    volume = VOLUMES["relief"]
    position = walk_rounds(PhotonPass(volume, sky(), 10), 3000, store=True)[0].position.astype(float)
    low, high = volume.bounds_mm
    assert np.all((position >= low) & (position <= high))
    x = np.linspace(0.0, 1.0, 20_001)
    surface = np.interp(position[:, 0], x, evaluate_grid(volume.surface_mm, (1.0, 1.0), x % 1.0, np.array([0.5]))[:, 0])
    slope = np.abs(np.diff(volume.surface_mm[:, 0])).max() * 100
    assert np.all(position[:, 2] > surface - 1e-4 * slope)


def test_exits_are_the_photons_that_leave_upwards():
    exits = []
    volume = slab_volume([Layer(1.0, 0.0, 20.0, 0.0)], size=(4.0, 4.0))
    counts = PhotonPass(volume, beam(radius=0.0, position=(2.0, 2.0)), 11).walk(0, np.array([20_000]), False, exits)
    (left,), counts = exits, counts.tallies[0]
    assert len(left) == counts[tally.REFLECTED] - counts[tally.SPECULAR]
    assert np.count_nonzero(left[:, 5] == 0.0) == counts[tally.REFLECTED_UNSCATTERED] - counts[tally.SPECULAR]
    assert np.all(left[:, 4] < 0.0)
    assert np.linalg.norm(left[:, 2:5], axis=1) == pytest.approx(1.0, abs=1e-5)
    for component in (left[:, 0] - 2.0, left[:, 1] - 2.0, left[:, 2], left[:, 3]):
        assert_mean(component[left[:, 5] == 1.0].astype(float), 0.0, 4)


def test_published_slabs():
    """Van de Hulst (1980): a matched slab of anisotropic scattering; Giovanelli (1955): a half space of index 1.5."""
    thin = slab_volume([Layer(0.2, 1.0, 9.0, 0.75, 1.0)], below=1.0)
    counts = sum(one.tallies[0] for one in walk_rounds(PhotonPass(thin, beam(), 12), 50_000, 4))
    assert_share(counts[tally.REFLECTED], 200_000, 0.09739, 3)
    assert_share(counts[tally.TRANSMITTED], 200_000, 0.66096, 3)
    half_space = slab_volume([Layer(20.0, 1.0, 9.0, 0.0, 1.5)])
    counts = sum(one.tallies[0] for one in walk_rounds(PhotonPass(half_space, beam(), 13), 50_000, 4))
    assert_share(counts[tally.REFLECTED], 200_000, 0.2600, 3)


@pytest.mark.skipif(not binding.get_host_cpu_features().get("avx2"), reason="no AVX2")
@pytest.mark.parametrize("block_pass, least", [
    (fly, 40), (wrap, 10), (locate, 10), (look_around, 10), (collide, 80), (emit, 300), (meet_plane, 15), (pass_surface, 60)
])  # fmt: skip
def test_block_passes_are_vectorized(block_pass, least):
    """Packed 256 or 512 bit operations in the machine code; one unlucky branch, and there are none."""
    real, words, count, double = numba.float32, numba.int32[::1], numba.int64, numba.float64
    reals = real[::1]
    signature = {
        fly: (reals, words, count), wrap: (reals, count, real, real),
        locate: (reals, words, count, reals, words, count, count), look_around: (reals, words, count, real, real, reals, words),
        collide: (reals, words, count, count, count), meet_plane: (reals, words, count, double, double),
        pass_surface: (reals, words, count, double, double),
        emit: (reals, words, count, count, count, count, count, numba.types.UniTuple(double, LAMP_SIZE), double, double),
    }[block_pass]  # fmt: skip
    options = {name: value for name, value in block_pass.targetoptions.items() if name != "nopython"}
    (assembly,) = numba.njit(signature, **options)(block_pass.py_func).inspect_asm().values()
    packed = re.findall(r"^\s*v\w+(?:ps|d)\s.*%[yz]mm", assembly, re.MULTILINE)
    assert len(packed) > least
