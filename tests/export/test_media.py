"""Sharing labels keeps sums, indices and the outside apart, and tells its error."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.export.media import make_media


def voxels(count: int, seed: int = 1):
    generator = np.random.default_rng(seed)
    mu_a, mu_s = np.exp(generator.normal(size=(2, count)))
    return mu_a, mu_s, mu_s * generator.uniform(0.5, 0.9, count), np.ones(count, bool)


def test_few_kinds_are_exact():
    mu_a, mu_s = np.repeat([0.1, 0.2, 0.0], 4), np.repeat([10.0, 0.0, 3.0], 4)
    media = make_media(mu_a, mu_s, 0.8 * mu_s, 1.4, np.ones(12, bool))
    assert media.label.dtype == np.uint8
    assert len(media.mu_a) == 3
    assert media.error == 0.0
    assert media.mu_a[media.label - 1] == pytest.approx(mu_a)
    assert media.g[media.label - 1] == pytest.approx(np.where(mu_s > 0, 0.8, 0.0))


@pytest.mark.parametrize("most", [1, 10, 300])
def test_many_kinds_share_labels_and_keep_sums(most):
    mu_a, mu_s, scatter_g, inside = voxels(5000)
    inside[::7] = False
    media = make_media(mu_a, mu_s, scatter_g, 1.4, inside, most=most)
    assert len(media.mu_a) <= most
    assert np.array_equal(media.label == 0, ~inside)
    medium = media.label[inside].astype(int) - 1
    assert media.mu_a[medium].sum() == pytest.approx(mu_a[inside].sum())
    assert (media.mu_s * media.g)[medium].sum() == pytest.approx(scatter_g[inside].sum())
    off = np.maximum(np.abs(media.mu_a[medium] / mu_a[inside] - 1), np.abs(media.mu_s[medium] / mu_s[inside] - 1))
    assert off.max() == pytest.approx(media.error)


def test_voxels_of_unlike_index_never_share():
    mu_a, mu_s, scatter_g, inside = voxels(1000)
    n = np.where(np.arange(1000) % 2, 1.4, 1.5)
    media = make_media(mu_a, mu_s, scatter_g, n, inside, most=2)
    assert media.n[media.label - 1] == pytest.approx(n)
