"""Roulette on storage: unbiased in every depth bin, and its weights can be found again from the map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.photonmap.roulette import FULL_DEPTH, LEAST, keep_all, keep_visible
from skinrender.transport.walk import kept
from tests.stats import assert_same_means
from tests.volumes import Layer, beam, fractions, furrow, slab_volume, walk_rounds

LAYERS = [Layer(0.1, 2.0, 18.0, g=0.6), Layer(0.4, 0.5, 30.0, g=0.6)]


def optical_depth(z):
    return np.interp(z, [0.0, 0.1, 0.5], [0.0, 2.0, 2.0 + 0.4 * 30.5])


def test_all_photons_that_can_be_seen_are_kept():
    table = keep_visible(slab_volume(LAYERS, planes=[2, 8]))
    keep, edges = table.keep_probability[0], table.depth_edges_mm
    lower = optical_depth(edges[:-1])
    assert np.all(keep[lower <= FULL_DEPTH] == 1.0)
    assert np.all(keep >= np.float32(LEAST)) and np.all(np.diff(keep) <= 0.0)
    assert keep == pytest.approx(np.clip(np.exp(FULL_DEPTH - lower), LEAST, 1.0), rel=1e-5)


def test_the_clearest_column_counts():
    """A dark column beside a clear one must not hide what is seen through the clear one."""
    volume = slab_volume(LAYERS, columns=(4, 4), planes=[2, 8])
    dark = volume.palette_index.copy()
    dark[:2] = 2
    uniform, mixed = (keep_visible(replace(volume, palette_index=p)).keep_probability for p in (dark[:2], dark))
    assert np.all(mixed >= uniform) and np.any(mixed > uniform)


def test_table_of_the_kernel():
    table = keep_visible(slab_volume(LAYERS))
    values = table.thresholds(0)
    assert values[0] == pytest.approx(1.0 / np.diff(table.depth_edges_mm)[0])
    assert np.array_equal(values[1:], table.keep_probability[0].astype(float))
    assert keep_all(slab_volume(LAYERS)).thresholds(0) is None


def test_a_photon_is_judged_by_the_bin_of_its_rounded_depth():
    keep, words = np.array([10.0, 1.0, 0.0, 1.0, 0.0]), np.zeros(4 * 512, np.int32)
    words[:] = 12345
    for z, expected in ((-0.2, True), (-0.05, True), (0.05, False), (0.15, True), (0.35, False), (9.0, False)):
        assert kept(words, 0, z, -0.1, keep) == expected


@pytest.mark.parametrize("surface", [None, furrow(0.05)], ids=["flat", "relief"])
def test_weighted_photons_are_unbiased_at_every_depth(surface):
    volume = slab_volume(LAYERS, planes=[2, 8], surface=surface)
    light, bins = beam(20.0, radius=0.0), np.linspace(-0.01, 0.5, 18)
    counts = []
    for roulette, seed in ((False, 3), (True, 4)):
        photon_pass = PhotonPass(volume, light, seed, roulette=roulette)
        table, rounds = photon_pass.depth_table, []
        for one in walk_rounds(photon_pass, 1000, 40, store=True):
            z = one.position[:, 2].astype(float)
            weight = np.ones(z.size)
            if roulette:
                bin_ = np.floor((z - table.depth_edges_mm[0]) / np.diff(table.depth_edges_mm)[0]).astype(int)
                weight = 1.0 / table.keep_probability[0][np.clip(bin_, 0, table.keep_probability.shape[1] - 1)]
            rounds.append(np.histogram(z, bins, weights=weight)[0])
        counts.append(np.array(rounds))
    # bins that keep one photon in thousands have too few for a z-test of rounds
    well_filled = (counts[1] > 0).mean(axis=0) > 0.9
    assert well_filled.sum() > 8
    assert_same_means(counts[0][:, well_filled], counts[1][:, well_filled])


def test_roulette_keeps_fewer_photons_and_the_same_histories():
    volume = slab_volume(LAYERS, planes=[2, 8])
    walks = [walk_rounds(PhotonPass(volume, beam(), 3, roulette=r), 2000, 10, store=True) for r in (False, True)]
    stored = [sum(int(one.stored_per_band[0]) for one in walked) for walked in walks]
    assert stored[1] < 0.5 * stored[0]
    assert_same_means(*map(fractions, walks))
