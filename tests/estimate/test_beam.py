"""The beam estimate against the plain sum over all photons and rays, with the paper's kernel."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from skinrender.estimate.ray_paths import visible_depth_mm
from skinrender.film.camera import view_rays
from tests.direct_sum import beam_sum, biweight, gaussian, photons_of, rays_of
from tests.maps import W_PER_MM2, Lit, light_up, see, slab_data, slab_layer

PIXELS, INNER, SIZE_MM, N, G = 32, slice(8, -8), 2.0, 1.4, 0.6
LAYERS = [slab_layer(0.1, 2.0, 20.0, G, N), slab_layer(0.5, 0.3, 10.0, G, N)]
RADIUS_MM = 0.4
VIEWS = {
    "straight": {},
    "aslant": {"zenith_deg": 50.0},
    "detail aslant": {"zenith_deg": 50.0, "window_mm": (1.0, 1.0)},
}


@cache
def lit() -> Lit:
    return light_up(slab_data(LAYERS, {"kind": "collimated"}, SIZE_MM, PIXELS), 400)


def depth_of(entry: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Vertical optical depth of the two layers."""
    return 22.0 * np.minimum(depth, 0.1) + 10.3 * np.maximum(depth - 0.1, 0.0)


def estimated(view: str) -> np.ndarray:
    """The estimate far from the picture's border, beyond which it knows no photons, (n, n) W mm^-2 sr^-1."""
    image, _ = see(lit(), "beam", VIEWS[view])
    return image.multiple_Y[INNER, INNER].astype(float) * W_PER_MM2


@cache
def summed(view: str, kernel: Callable = biweight) -> np.ndarray:
    """The plain sum over the same photons for the same pixels."""
    rays = view_rays(lit().scene.camera.model_copy(update=VIEWS[view]), lit().volume.size_mm)
    inner = rays_of(rays.origin[INNER, INNER], rays.direction[INNER, INNER], N)
    photons = photons_of(lit().photons, visible_depth_mm(lit().volume))
    plain = beam_sum(photons, inner, lit().volume, depth_of, RADIUS_MM, kernel)
    return plain.reshape(rays.origin[INNER, INNER].shape[:2])


def ellipse(offset: np.ndarray, radius: float) -> np.ndarray:
    """The Gaussian that is round in the picture of a camera tilted in x, not on the skin."""
    stretch = np.sqrt(np.cos(np.radians(VIEWS["aslant"]["zenith_deg"])))
    return gaussian(offset * [stretch, 1.0 / stretch], radius)


@pytest.mark.parametrize("view, kernel", [("straight", gaussian), ("aslant", ellipse), ("detail aslant", ellipse)])
def test_pixels_follow_the_plain_sum(view, kernel):
    """Noise and all, as both see the same photons; a pixel's width is the only difference."""
    image, plain = estimated(view), summed(view, kernel)
    assert image.mean() == pytest.approx(plain.mean(), rel=5e-3)
    assert np.std(image - plain) < 0.15 * plain.std()


def test_kernel_of_equal_variance_may_take_the_place_of_the_papers():
    paper, ours = summed("straight"), summed("straight", gaussian)
    assert ours.mean() == pytest.approx(paper.mean(), rel=2e-3)
    assert np.std(ours - paper) < 0.5 * paper.std()


def test_gather_count_is_what_a_beam_meets():
    _, summary = see(lit(), "beam", gather_count=1200)
    assert summary.photons_gathered == pytest.approx(1200, rel=0.1)


def test_wide_kernels_have_less_noise_and_the_same_mean():
    (narrow, a), (wide, b) = see(lit(), "beam", gather_count=1), see(lit(), "beam")
    assert wide.stderr_Y.mean() < 0.5 * narrow.stderr_Y.mean()
    assert b.mean_radiance == pytest.approx(a.mean_radiance, rel=1e-5)
    assert b.mean_radiance_stderr == pytest.approx(a.mean_radiance_stderr, rel=1e-4)


def test_more_photons_wanted_than_there_are_is_the_widest_kernel():
    (many, _), (widest, _) = see(lit(), "beam", gather_count=10**9), see(lit(), "beam")
    assert np.array_equal(many.radiance, widest.radiance)


def test_spectra_take_a_wider_kernel_than_luminance():
    """More bands, each with its own noise: the luminance is that of one kernel, and colors are less noisy."""
    data = {**slab_data(LAYERS, {"kind": "collimated"}, 4.0, PIXELS), "bands_nm": [460, 500, 540, 580, 620, 660]}
    colored = light_up(data, 100)
    (one_kernel, _), (two, _) = see(colored, "beam", gather_count=10**9), see(colored, "beam")
    assert two.y() == pytest.approx(one_kernel.y(), rel=1e-5)
    assert np.array_equal(two.stderr_Y, one_kernel.stderr_Y)
    spread = [(image.radiance / image.y()[:, :, None]).std(axis=(0, 1)).mean() for image in (one_kernel, two)]
    assert spread[1] < 0.5 * spread[0]
    means = [image.radiance.mean(axis=(0, 1)) for image in (one_kernel, two)]
    assert means[1] == pytest.approx(means[0], rel=5e-3)
