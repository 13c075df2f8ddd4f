"""Small slabs for the stiff and extreme cases, as scene files hold them: one band, matched index, lit from above."""

from __future__ import annotations

from typing import Any

NORMAL = {"kind": "collimated", "spectrum": "E"}
PENCIL = {"kind": "collimated", "spectrum": "E", "radius_mm": 0.0}


def layer(thickness_mm: float, mu_a: float, mu_s: float, g: float = 0.0, n: float = 1.0, **more: Any) -> dict[str, Any]:
    """A layer; lengths in mm, coefficients in 1/mm."""
    optics = {"mu_a_per_mm": mu_a, "mu_s_per_mm": mu_s, "g": g, "refractive_index": n}
    return {"thickness_mm": thickness_mm, **optics, **more}


def half_space(albedo: float, mu_t: float = 10.0, depths: float = 1e4) -> dict[str, Any]:
    """An isotropic layer so thick that nothing comes back from its bottom."""
    return layer(depths / mu_t, (1.0 - albedo) * mu_t, albedo * mu_t)


def slab(
    *layers: dict[str, Any], size_mm: float = 1.0, columns: int = 1, pixels: int = 4, light: dict[str, Any] = NORMAL,
    camera: dict[str, Any] | None = None, **sections: Any,
) -> dict[str, Any]:  # fmt: skip
    """A scene of layers under a square patch; the camera sees no reflection by the surface."""
    return {
        "patch": {"size_mm": [size_mm, size_mm], "columns": [columns, columns]},
        "bands_nm": [550],
        "slab": {"layers": list(layers)},
        "below": {"refractive_index": 1.0},
        "light": light,
        "camera": {"pixels": [pixels, pixels], "cross_polarized": True, **(camera or {})},
        **sections,
    }
