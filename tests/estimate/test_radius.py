"""Kernel radii: narrow at a hard lateral edge of the epidermis, wide everywhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from skinrender.estimate.kernel_filter import correlate, gaussian
from skinrender.estimate.radius import (
    ALIKE,
    STEPS,
    WIDEST_MM,
    gather_radius_mm,
    lesion_absorbance,
    radius_levels,
)
from skinrender.photonmap.light import light_from_scene
from skinrender.scene.load import make_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import SkinVolume
from tests.maps import Lit, make_map, see
from tests.volumes import Layer, slab_volume

SIZE, COLUMNS = (4.0, 1.0), (80, 20)
SPACING_MM = 0.05
EPIDERMIS, DERMIS, DARKER = Layer(0.1, 0.5, 30.0), Layer(1.0, 0.2, 15.0), 8.0
X = (np.arange(COLUMNS[0]) + 0.5) * SPACING_MM


def stained(added: np.ndarray, epidermis: Layer = EPIDERMIS, dermis: Layer = DERMIS, layer: int = 1) -> SkinVolume:
    """Skin of two layers, one of which absorbs more by `added` (nx,) 1/mm, the same at all y."""
    volume = slab_volume([epidermis, dermis], size=SIZE, columns=COLUMNS)
    shades, shade = np.unique(np.append(0.0, added), return_inverse=True)
    entries = np.concatenate([[0, 1, 2], np.full(len(shades) - 1, layer)])
    index = volume.palette_index.copy()
    index[:, :, layer - 1] = np.where(shade[1:] > 0, 2 + shade[1:], layer)[:, None]
    mu_a = volume.mu_a[entries].copy()
    mu_a[3:, 0] += shades[1:]
    return replace(
        volume, palette_index=index, palette_layer=volume.palette_layer[entries], mu_a=mu_a, mu_s=volume.mu_s[entries],
        g=volume.g[entries], palette_melanin=np.linspace(0.0, 1.0, len(entries), dtype=np.float32),
    )  # fmt: skip


def radii_mm(volume: SkinVolume, widest_mm: float = WIDEST_MM, spacing_mm: float = SPACING_MM) -> np.ndarray:
    """Radius of every pixel of a straight view, (h, w)."""
    w, h = (round(length / spacing_mm) for length in SIZE)
    x, y = (np.arange(w) + 0.5) * spacing_mm, (np.arange(h) + 0.5) * spacing_mm
    points = np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1).reshape(-1, 2)
    level, radii = radius_levels(volume, points, (h, w), spacing_mm, widest_mm)
    return radii[level] * spacing_mm


HARD_EDGE = np.where(X < 2.0, DARKER, 0.0)


def test_absorbance_is_what_the_lesion_adds():
    assert lesion_absorbance(stained(HARD_EDGE), 0.5) == pytest.approx(np.repeat(HARD_EDGE[:, None] * 0.1, COLUMNS[1], axis=1))


def test_absorbance_of_a_blue_ink_is_that_in_the_red():
    volume = stained(HARD_EDGE)
    bands = np.array([400.0, 450.0, 650.0])
    mu_a = np.repeat(volume.mu_a, 3, axis=1)
    mu_a[volume.palette_layer == 1, :2] = EPIDERMIS.mu_a
    mu_a[3, 0] += 100.0  # below 450 nm nothing counts
    blue = replace(volume, mu_a=mu_a, wavelength_nm=bands)
    assert np.array_equal(lesion_absorbance(blue, 0.5), lesion_absorbance(volume, 0.5)) and lesion_absorbance(blue, 0.5).max() > ALIKE


def test_even_skin_has_the_widest_kernel_everywhere():
    assert radii_mm(stained(np.zeros(80))) == pytest.approx(WIDEST_MM)


def test_kernel_narrows_at_a_hard_edge_and_is_wide_elsewhere():
    radii = radii_mm(stained(HARD_EDGE))
    # the pattern repeats: its other edge is at the patch's sides
    distance = np.minimum(abs(X - 2.0), np.minimum(X, 4.0 - X))
    assert np.all(radii[:, distance < SPACING_MM] == STEPS[0] * SPACING_MM)
    assert np.all(radii[:, distance > WIDEST_MM] == pytest.approx(WIDEST_MM))
    near = distance < 0.15
    assert np.all(radii[:, near] < 0.6 * WIDEST_MM)
    order = np.argsort(distance)
    assert np.all(np.diff(radii[0, order]) >= 0.0)
    assert np.isclose(radii, WIDEST_MM).mean() > 0.5
    assert np.array_equal(radii, np.broadcast_to(radii[0], radii.shape))


def test_both_sides_of_an_edge_are_alike():
    radii = radii_mm(stained(HARD_EDGE))
    assert np.array_equal(radii, radii[:, ::-1])


def test_no_kernel_mixes_more_absorbance_than_it_may():
    """But for the narrowest, which is never given up."""
    pattern = np.random.default_rng(4).uniform(0.0, 2.0, 80) * (X > 1.0)
    volume = stained(pattern)
    seen = lesion_absorbance(volume, WIDEST_MM).T.astype(np.float32)
    at_ray = correlate(seen, gaussian(STEPS[0]), wrap=True)
    radii = radii_mm(volume) / SPACING_MM
    for radius in np.unique(radii)[1:]:
        mean = correlate(seen, gaussian(radius), wrap=True)
        assert abs(mean - at_ray)[radii == radius].max() <= ALIKE * (1 + 1e-4)


def test_a_gradient_costs_nothing():
    ramp = np.where(X < 2.0, X, 4.0 - X) * 4.0
    radii = radii_mm(stained(ramp))
    assert np.all(radii[:, (abs(X - 1.0) < 0.5) | (abs(X - 3.0) < 0.5)] == pytest.approx(WIDEST_MM))


def test_faint_lesion_does_not_narrow_the_kernel():
    assert radii_mm(stained(HARD_EDGE * (0.9 * ALIKE / (DARKER * 0.1)))) == pytest.approx(WIDEST_MM)


def test_deep_lesion_narrows_only_kernels_wider_than_it_is_deep():
    """Light from below is blurred by the tissue above."""
    deep = stained(HARD_EDGE, epidermis=EPIDERMIS._replace(thickness=0.25), layer=2)
    assert radii_mm(deep, widest_mm=0.25) == pytest.approx(0.25)
    radii = radii_mm(deep, widest_mm=1.2)
    at_edge = np.minimum(abs(X - 2.0), np.minimum(X, 4.0 - X)) < SPACING_MM
    assert np.all((radii[:, at_edge] > 0.2) & (radii[:, at_edge] < 0.6))


def test_light_that_has_not_been_deep_knows_nothing_of_deep_pigment():
    """Black below 0.4 mm: exp(-(0.4 - 0.15) / 0.4) of the light is taken, a plane of 0.1 mm counted at its middle."""
    planes = [EPIDERMIS._replace(thickness=0.4), DERMIS._replace(thickness=0.1)]
    black = stained(np.full(80, 1e3), *planes, layer=2)
    pale = stained(np.zeros(80), *planes, layer=2)
    index = black.palette_index.copy()
    index[:40] = pale.palette_index[:40]
    absorbance = lesion_absorbance(replace(black, palette_index=index), 1.0)
    assert absorbance[0, 0] == 0.0
    assert np.exp(-absorbance[-1, 0]) == pytest.approx(1.0 - np.exp(-(0.45 - 0.15) / 0.4))


def test_wanted_radius_bounds_all():
    radii = radii_mm(stained(HARD_EDGE), widest_mm=0.12)
    assert radii.max() == pytest.approx(0.12)
    assert radii.min() == STEPS[0] * SPACING_MM


def test_coarse_pixels_have_the_narrowest_kernel_there_is():
    assert radii_mm(stained(HARD_EDGE), spacing_mm=0.5) == pytest.approx(STEPS[0] * 0.5)


def test_gather_radius_holds_the_photons_wanted():
    radius = gather_radius_mm(500, 200_000, (10.0, 5.0))
    assert np.pi * radius**2 * 200_000 / 50.0 == pytest.approx(500)
    assert gather_radius_mm(None, 200_000, (10.0, 5.0)) == WIDEST_MM
    assert gather_radius_mm(10**9, 10, (10.0, 5.0)) == WIDEST_MM
    assert gather_radius_mm(5, 0, (10.0, 5.0)) == WIDEST_MM


@pytest.mark.slow
@pytest.mark.parametrize("bands_nm", [[450], [450, 650]], ids=["one band", "a spectrum"])
def test_profile_across_a_hard_edge_is_that_of_the_reference(tmp_path, bands_nm):
    """Macule of +0.15 melanosomes, pixels of 0.05 mm; the reference has no kernel but the pixel."""
    pattern = np.full((20, 160), 255, np.uint8)
    pattern[:, :80] = 0
    Image.fromarray(pattern).save(tmp_path / "edge.png")
    scene = make_scene(
        {
            "patch": {"size_mm": SIZE, "columns": [160, 20]}, "bands_nm": bands_nm,
            "skin": {"border_wave": {"peak_to_valley_um": 0}}, "relief": {"kind": "flat"},
            "lesions": [{"kind": "epidermal", "pattern": "edge.png", "melanin_scale": 0.15}],
            "light": {"kind": "collimated", "spectrum": "E"}, "camera": {"pixels": COLUMNS, "cross_polarized": True},
        },
        source_dir=tmp_path,
    )  # fmt: skip
    volume, light = build_volume(scene), light_from_scene(scene)
    found, expected = [], []
    for seed in range(1, 7):
        lit = Lit(scene, volume, make_map(volume, light, 100_000, seed=seed))
        pictures = [see(lit, method)[0].radiance for method in ("beam", "reference")]
        for picture, profiles in zip(pictures, (found, expected)):
            profiles.append([_from_edge(picture[:, :, band]) for band in range(len(bands_nm))])
    ratio = np.mean(found, axis=0) / np.mean(expected, axis=0)
    noise = np.std(np.array(found) - expected, axis=0, ddof=1) / np.sqrt(6) / np.mean(expected, axis=0)
    blue = expected[0][0]
    assert blue[0] < 0.7 * blue[-1]
    assert noise.max() < 0.01
    assert abs(ratio - 1.0).max() < 0.03, np.round(100 * (ratio - 1.0), 2)


def _from_edge(picture: np.ndarray) -> np.ndarray:
    """Mean over rows and both edges, by pixels from the darkest to the lightest, half a period."""
    x = picture.mean(axis=0, dtype=float)
    middle = x[20:60]
    sides = np.roll(x, 40)[20:60][::-1]
    return 0.5 * (middle + sides)
