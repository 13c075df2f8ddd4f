"""The point estimate against the plain sum over all photons and sample points."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.estimate.gather_points import depth_share
from skinrender.estimate.point import MARCH_MM, WIDEST_MM, march_edges
from skinrender.estimate.ray_paths import visible_depth_mm
from skinrender.film.camera import view_rays
from tests.direct_sum import photons_of, point_sum, rays_of
from tests.maps import W_PER_MM2, Lit, light_up, see, slab_data, slab_layer

PIXELS, SIZE_MM, N, MU_T = 8, 1.0, 1.4, 20.5
LAYER = slab_layer(0.4, 0.5, 20.0, 0.7, N)


@pytest.fixture(scope="module")
def lit() -> Lit:
    return light_up(slab_data([LAYER], {"kind": "collimated"}, SIZE_MM, PIXELS), 250)


def plain_sum(lit: Lit, camera: dict, corrected: bool = True) -> np.ndarray:
    view = view_rays(lit.scene.camera.model_copy(update=camera), lit.volume.size_mm)
    deepest = visible_depth_mm(lit.volume)
    photons, steps = photons_of(lit.photons, deepest), march_edges(deepest)
    radius = np.full(len(steps) - 1, WIDEST_MM)
    share = depth_share(steps, radius, photons.position[:, 2]) if corrected else 1.0
    return point_sum(
        photons, rays_of(view.origin, view.direction, N), lit.volume, lambda entry, depth: MU_T * depth, steps, radius, share
    ).reshape(PIXELS, PIXELS)


@pytest.mark.parametrize("camera", [{}, {"zenith_deg": 50.0, "azimuth_deg": 30.0}], ids=["straight", "aslant"])
def test_picture_is_the_plain_sum(lit, camera):
    image, _ = see(lit, "point", camera)
    assert image.multiple_Y * W_PER_MM2 == pytest.approx(plain_sum(lit, camera), rel=3e-3)


def test_spheres_alone_lose_a_sixth_of_the_light(lit):
    """Above the surface there are no sample points."""
    image, _ = see(lit, "point")
    uncorrected = plain_sum(lit, {}, corrected=False).mean()
    assert 0.5 < uncorrected / (image.multiple_Y.mean(dtype=float) * W_PER_MM2) < 0.84


def test_march_steps_cover_the_depth():
    for deepest in (1e-4, 0.013, 0.3994, 2.0):
        edges = march_edges(deepest)
        assert edges[0] == 0.0 and edges[-1] == deepest
        assert np.allclose(np.diff(edges), deepest / (len(edges) - 1)) and np.diff(edges).max() <= MARCH_MM * (1 + 1e-9)


def test_share_of_a_photon_deep_inside_is_one():
    edges = march_edges(1.0)
    share = depth_share(edges, np.full(len(edges) - 1, 0.1), np.linspace(0.0, 1.0, 401))
    inside = slice(41, -41)
    assert share[inside] == pytest.approx(1.0, rel=0.015)
    # half of a sphere that would hold it stands above the surface
    assert share[0] == pytest.approx(0.5, rel=0.01) and share[-1] == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("radius_mm", [0.011, 0.03, 0.1])
def test_no_photon_falls_between_sample_points(radius_mm):
    edges = march_edges(0.3)
    share = depth_share(edges, np.full(len(edges) - 1, radius_mm), np.linspace(0.0, 0.3, 3001))
    assert share.min() > 0.05


def test_sphere_radius_does_not_change_the_light(lit):
    (_, narrow), (_, wide) = see(lit, "point", gather_count=1), see(lit, "point")
    error = np.hypot(narrow.mean_radiance_stderr, wide.mean_radiance_stderr)
    assert abs(narrow.mean_radiance - wide.mean_radiance) < 4.0 * error
    assert error < 0.05 * wide.mean_radiance


def test_gather_count_is_what_a_sphere_holds():
    """But for spheres that reach out of the slab."""
    even = light_up(slab_data([{**LAYER, "mu_a_per_mm": 0.0}], {"kind": "collimated"}, SIZE_MM, 32), 400)
    _, summary = see(even, "point", gather_count=20)
    assert 14 < summary.photons_gathered < 22
