"""Even voxels: what is resampled keeps its place and its optical depth."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.export.grid import band_index, even_labels, flattened, mean_coefficients
from tests.volumes import Layer, slab_volume

LAYERS = (Layer(0.1, 2.0, 20.0, 0.8), Layer(0.25, 0.5, 10.0, 0.5), Layer(0.65, 0.1, 5.0, 0.9))


def test_labels_have_the_finest_height_and_fill_the_depth():
    volume = slab_volume(LAYERS, planes=(2, 1, 1))
    labels = even_labels(volume)
    assert labels.spacing_mm == pytest.approx([1.0, 1.0, 0.05])
    assert labels.entry[0, 0].tolist() == [1] * 2 + [2] * 5 + [3] * 13


def test_height_that_does_not_divide_the_depth_becomes_smaller():
    volume = slab_volume((Layer(0.3, 1, 1), Layer(0.7, 1, 1)))
    labels = even_labels(volume)
    assert labels.spacing_mm[2] == pytest.approx(0.25)
    assert labels.entry.shape[2] * labels.spacing_mm[2] == pytest.approx(1.0)


@pytest.mark.parametrize("cells", [1, 3, 7, 40])
def test_means_keep_the_optical_depth(cells):
    volume = slab_volume(LAYERS)
    planes = np.linspace(0.0, 1.0, cells + 1)
    means = mean_coefficients(
        volume, volume.palette_index, volume.z_edges_mm, 0, ([0, 0], [0]), planes, np.full(3, 1 / cells)
    )
    assert means.mu_a.shape == (2, 1, cells)
    for values, name in ((means.mu_a, "mu_a"), (means.mu_s, "mu_s")):
        assert values.sum(axis=2) / cells == pytest.approx(sum(layer.thickness * getattr(layer, name) for layer in LAYERS))
    scattering = sum(layer.thickness * layer.mu_s * layer.g for layer in LAYERS)
    assert means.scatter_g.sum(axis=2) / cells == pytest.approx(scattering)


def test_means_leave_out_air():
    surface = np.full((4, 4), 0.05, np.float32)
    volume = slab_volume((Layer(0.2, 1.0, 3.0), Layer(0.3, 2.0, 4.0)), surface=surface, planes=(4, 1))
    index = volume.palette_index.copy()
    index[:, :, 0] = 0
    means = mean_coefficients(volume, index, volume.z_edges_mm, 0, ([0], [0]), np.array([0.0, 0.1]), np.ones(3))
    assert means.tissue[0, 0, 0] == pytest.approx(0.5)
    assert (means.mu_a[0, 0, 0], means.mu_s[0, 0, 0]) == pytest.approx((1.0, 3.0))


def test_flattened_columns_begin_at_the_surface():
    surface = np.full((4, 4), 0.1, np.float32)  # everywhere 0.1 mm below the mean plane
    volume = slab_volume((Layer(0.2, 1, 1), Layer(0.8, 1, 1)), surface=surface, planes=(20, 80))
    index, planes = flattened(volume)
    center = 0.5 * (planes[1:] + planes[:-1])
    source = center + 0.1 * (1.0 - center)
    assert planes[0] == 0.0
    assert np.array_equal(index[0, 0], np.where(source < 0.2, 1, 2))


def test_flat_volume_is_left_as_it_is():
    volume = slab_volume(LAYERS)
    index, planes = flattened(volume)
    assert index is volume.palette_index
    assert planes is volume.z_edges_mm


def test_unknown_band_names_those_there_are():
    with pytest.raises(InputError, match="no band at 600 nm") as caught:
        band_index(slab_volume(LAYERS), 600.0)
    assert "choose one of 550" in str(caught.value)
