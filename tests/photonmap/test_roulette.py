"""Roulette on storage: unbiased in every depth bin, and its weights can be found again from the map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.photonmap.roulette import FULL_DEPTH, LEAST, keep_all, keep_visible
from skinrender.transport import lanes
from skinrender.transport.lanes import LANES, new_block
from skinrender.transport.rng import next_word
from skinrender.transport.storing import roll, thin_out
from tests.stats import assert_same_means
from tests.transport.block import row
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
    assert keep == pytest.approx(np.clip(np.exp(FULL_DEPTH - lower), LEAST, 1.0), rel=1e-5, abs=0.5**32)


def test_the_clearest_column_counts():
    """A dark column beside a clear one must not hide what is seen through the clear one."""
    volume = slab_volume(LAYERS, columns=(4, 4), planes=[2, 8])
    dark = volume.palette_index.copy()
    dark[:2] = 2
    uniform, mixed = (keep_visible(replace(volume, palette_index=p)).keep_probability for p in (dark[:2], dark))
    assert np.all(mixed >= uniform) and np.any(mixed > uniform)


def test_table_of_the_kernel():
    table = keep_visible(slab_volume(LAYERS))
    bins_per_mm, largest = table.thresholds
    assert bins_per_mm == pytest.approx(1.0 / np.diff(table.depth_edges_mm)[0])
    words_that_keep = largest.astype(float) + 2.0**31 + 1.0
    assert np.array_equal(words_that_keep / 2.0**32, table.keep_probability.astype(float)), "exact"
    assert keep_all(slab_volume(LAYERS)).thresholds is None


def test_a_photon_is_judged_by_the_bin_of_its_rounded_depth():
    always, never = 2**31 - 1, -(2**31)
    keep = 10.0, np.array([[never] * 4, [always, never, always, never]], np.int32)
    depth = [(-0.2, True), (-0.05, True), (0.05, False), (0.15, True), (0.35, False), (9.0, False)]
    f, w = new_block(np.float32)
    n = len(depth)
    row(f, lanes.Z, n)[:] = [z + 0.1 for z, _ in depth]
    row(w, lanes.BAND)[:], row(w, lanes.SHOWN)[:] = 1, 1
    roll(f, w, n, keep, -0.1)
    shown = thin_out(w, n, keep)
    assert row(w, lanes.LISTED, shown).tolist() == [i for i, (_, expected) in enumerate(depth) if expected]
    row(w, lanes.SHOWN)[0] = 0
    assert thin_out(w, n, keep) == shown - 1


def test_roulette_draws_a_new_word_for_each_lane():
    f, w = new_block(np.float32)
    w[: 4 * LANES] = np.random.default_rng(1).integers(-(2**31), 2**31, 4 * LANES)
    before = w.copy()
    roll(f, w, LANES, (1.0, np.zeros((1, 1), np.int32)), 0.0)
    for i in range(0, LANES, 17):
        drawn = next_word(*(before[k * LANES + i] for k in range(4)))
        assert (w[lanes.ROLLED + i], *(w[k * LANES + i] for k in range(4))) == drawn


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
