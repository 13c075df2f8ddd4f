"""What must not change the walk: how space is cut, its unit of length, the number type, the compiler."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from skinrender.photonmap import photon_pass as photon_pass_module
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.skin.volume import SkinVolume
from skinrender.transport import tally
from tests.stats import assert_same_means
from tests.volumes import Layer, beam, fractions, furrow, sky, slab_volume, walk_rounds

TISSUE = Layer(0.8, 0.5, 12.0, 0.7, 1.4)
STACK = [Layer(0.1, 2.0, 40.0, 0.8, 1.5), Layer(0.4, 0.3, 15.0, 0.6, 1.38), Layer(0.5, 0.1, 5.0, 0.8, 1.4)]


def photons(volume: SkinVolume, light=None, histories=2000, seed=1):
    return walk_rounds(PhotonPass(volume, light or beam(15.0, 40.0), seed), histories, store=True)[0]


def rounds(volume: SkinVolume, light=None, seed=1, histories=3000, count=20):
    return fractions(walk_rounds(PhotonPass(volume, light or beam(15.0, 40.0), seed), histories, count))


def assert_same_photons(a, b, scale=1.0):
    assert np.array_equal(a.tallies[:, : tally.COLLISIONS_NULL], b.tallies[:, : tally.COLLISIONS_NULL])
    assert np.array_equal(a.position * np.float32(scale), b.position)
    assert np.array_equal(a.direction, b.direction)


def cut(volume: SkinVolume, edges=None, columns=(1, 1), copies=1) -> SkinVolume:
    """A slab of one voxel cut into columns and at given planes, its palette entry repeated and dealt at random."""
    edges = volume.z_edges_mm if edges is None else np.asarray(edges)
    index = np.random.default_rng(5).integers(1, copies + 1, (*columns, edges.size - 1)).astype(np.uint16)
    entries = np.array([0, *[1] * copies])
    return replace(
        volume, z_edges_mm=edges, palette_index=index, palette_layer=volume.palette_layer[entries],
        palette_melanin=np.linspace(0.0, 1.0, copies + 1, dtype=np.float32), mu_a=volume.mu_a[entries],
        mu_s=volume.mu_s[entries], g=volume.g[entries],
    )  # fmt: skip


@pytest.mark.parametrize("surface", [None, furrow(0.1)], ids=["flat", "relief"])
@pytest.mark.parametrize(
    "edges, columns, copies",
    [(None, (50, 30), 1), (np.linspace(0.0, 0.8, 41), (1, 1), 1), (np.geomspace(1.0, 1.8, 30) - 1.0, (7, 5), 4)],
    ids=["columns", "planes", "unequal planes of equal entries"],
)
def test_homogeneous_slab_is_the_same_however_it_is_cut(edges, columns, copies, surface):
    whole = slab_volume([TISSUE], surface=surface)
    if surface is not None:
        whole = replace(whole, z_edges_mm=np.array([0.0, 0.8]), palette_index=np.ones((1, 1, 1), np.uint16))
    assert_same_photons(photons(whole), photons(cut(whole, edges, columns, copies)))


def test_stack_is_the_same_with_finer_voxels():
    """Majorant slabs may begin at other planes; then histories differ and their means may not."""
    coarse, fine = slab_volume(STACK), slab_volume(STACK, planes=[3, 7, 40], columns=(20, 20))
    assert_same_means(rounds(coarse, seed=1), rounds(fine, seed=2))


def test_layer_cut_into_two_of_equal_tissue_is_the_same():
    whole = rounds(slab_volume([TISSUE]), seed=1)
    halves = rounds(slab_volume([TISSUE._replace(thickness=0.3), TISSUE._replace(thickness=0.5)]), seed=2)
    first = tally.PER_LAYER - 2
    joined = np.concatenate([halves[:, :first], halves[:, [first]] + halves[:, [first + 1]],
                             halves[:, [first + 2]] + halves[:, [first + 3]]], axis=1)  # fmt: skip
    assert_same_means(whole, joined)


def test_dark_columns_are_the_same_with_more_columns():
    """A lateral pattern of 2 x 2 columns drawn with 40 x 40."""
    layers = [Layer(0.3, 0.2, 10.0, 0.5), Layer(0.3, 4.0, 10.0, 0.5)]
    pattern = np.array([[1, 2], [1, 1]], np.uint16)
    walks = []
    for columns in (2, 40):
        volume = slab_volume(layers, columns=(columns, columns))
        index = np.kron(pattern, np.ones((columns // 2, columns // 2), np.uint16))
        walks.append(photons(replace(volume, palette_index=np.repeat(index[:, :, None], 2, axis=2))))
    assert_same_photons(*walks)


def test_volume_and_light_turned_by_a_quarter_reflect_the_same():
    index = np.random.default_rng(6).integers(1, 4, (6, 6, 3)).astype(np.uint16)
    volume = replace(slab_volume(STACK, fresnel=False), palette_index=index)
    turned = replace(volume, palette_index=np.ascontiguousarray(index.transpose(1, 0, 2)[::-1]))
    assert_same_means(rounds(volume, beam(50.0, 20.0), 3), rounds(turned, beam(50.0, 110.0), 4))


def scaled(volume: SkinVolume, factor: float) -> SkinVolume:
    surface = None if volume.surface_mm is None else volume.surface_mm * np.float32(factor)
    return replace(
        volume, z_edges_mm=volume.z_edges_mm * factor, border_z_mm=volume.border_z_mm * factor, surface_mm=surface,
        size_mm=(volume.size_mm[0] * factor, volume.size_mm[1] * factor), mu_a=volume.mu_a / factor,
        mu_s=volume.mu_s / factor,
    )  # fmt: skip


@pytest.mark.parametrize("sides", ["periodic", "open"])
@pytest.mark.parametrize("factor", [0.5, 2.0, 0.03125])
def test_lengths_times_a_power_of_2_scale_the_same_histories(factor, sides):
    """Bit for bit; patches below 1 mm, so that both are one tile."""
    volume = slab_volume(STACK[:2], size=(0.25, 0.25), columns=(4, 4), sides=sides)
    assert_same_photons(photons(volume), photons(scaled(volume, factor)), factor)


@pytest.mark.parametrize("factor", [0.01, 3.7])
def test_lengths_times_any_factor_scale_alike(factor):
    volume = slab_volume(STACK, surface=furrow(0.05), planes=[4, 4, 4])
    assert_same_means(rounds(volume, seed=1), rounds(scaled(volume, factor), seed=2))


CLEAR_TOP = [Layer(0.5, 0.0, 0.0), Layer(1.0, 1.0, 99.0, -0.5, 1.5)]


@pytest.mark.parametrize("layers", [STACK, CLEAR_TOP], ids=["skin", "clear top"])
def test_single_and_double_precision_agree(layers, monkeypatch):
    volume, walks = slab_volume(layers, below=1.0), []
    for real, seed in ((np.float32, 1), (np.float64, 2)):
        monkeypatch.setattr(photon_pass_module, "block_type", lambda *_, real=real: real)
        walks.append(rounds(volume, sky(), seed))
    assert_same_means(*walks)


WALK_IN_PYTHON = """
import json
import numpy as np
from tests.statistical.test_invariance import few_photons
print(json.dumps([[one.tallies.tolist(), one.position.tolist()] for one in few_photons()]))
"""


def few_photons():
    layers = [Layer(0.1, 4.0, 20.0, 0.8, 1.5), Layer(0.2, 2.0, 10.0, 0.0, 1.3)]
    volumes = [slab_volume(layers, planes=[2, 2], surface=surface) for surface in (None, furrow(0.05, samples=20))]
    return [photons(volume, sky(), histories=20, seed=7) for volume in volumes]


def test_kernels_walk_the_same_as_plain_python(repository):
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(repository)}
    # numpy warns where machine words wrap
    command = [sys.executable, "-W", "ignore::RuntimeWarning", "-c", WALK_IN_PYTHON]
    run = subprocess.run(command, env=environment, cwd=repository, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    for compiled, (tallies, position) in zip(few_photons(), json.loads(run.stdout), strict=True):
        assert tallies == compiled.tallies.tolist()
        assert len(position) > 20 and np.allclose(position, compiled.position, atol=1e-5)
