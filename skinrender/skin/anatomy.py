"""The layers of skin: thickness, voxel layers, what each is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from skinrender.errors import InputError, SceneError
from skinrender.optics import chromophores
from skinrender.optics.tables import read_rows, spectrum_on_bands
from skinrender.optics.tissue import Tissue, tissue_optics

EPIDERMIS = ("stratum_corneum", "granular_spinous", "basal")
DERMIS = ("papillary", "subpapillary", "upper_plexus", "reticular", "lower_plexus")
LAYER_NAMES = (*EPIDERMIS, *DERMIS, "subcutis")
VOXEL_LAYERS = dict(zip(LAYER_NAMES, (4, 9, 2, 10, 8, 8, 20, 2, 30)))
RETICULAR_VOXEL_LAYERS = {"cheek": 26}
"""Voxel layers of the reticular layer that keep its voxels 50 um high at a site where it is thicker."""
EXPLICIT = ("mu_a_per_mm", "mu_s_per_mm", "g", "refractive_index")
_COMPOSITION = ("melanosome", "blood", "saturation", "vessel_radius_um", "water", "fat")
_TABLE_NAMES = {
    "papillary_dermis": "papillary",
    "upper_blood_net": "upper_plexus",
    "reticular_dermis": "reticular",
    "deep_blood_net": "lower_plexus",
    "subcutaneous": "subcutis",
}


@dataclass(frozen=True, eq=False)
class LayerOptics:
    """Coefficients of one layer for P melanin contents: mu_a, mu_s, g (P, B), 1/mm; refractive_index (B,)."""

    mu_a: np.ndarray
    mu_s: np.ndarray
    g: np.ndarray
    refractive_index: np.ndarray


@dataclass(frozen=True)
class LayerSpec:
    """One layer as described.

    Parameters
    ----------
    name : as in ``LAYER_NAMES``, or any name in a slab.
    thickness_mm, voxel_layers : its height and the number of equal voxel layers in it.
    tissue : what it is made of.
    explicit : optics that replace those of the tissue: any of mu_a_per_mm, mu_s_per_mm, g, refractive_index, each a
        number or values by wavelength (nm).
    """

    name: str
    thickness_mm: float
    voxel_layers: int = 1
    tissue: Tissue = field(default_factory=Tissue)
    explicit: Mapping[str, float | Mapping[float, float]] = field(default_factory=dict)

    def optics(self, wavelength_nm: np.ndarray, melanin: np.ndarray) -> LayerOptics:
        """Coefficients for the melanosome fractions ``melanin`` (P,).

        An explicit mu_a belongs to the layer's own melanosome fraction; what a lesion adds absorbs on top of it. An
        explicit g alone keeps the reduced scattering, which is what measurements of skin know well.
        """
        given = {
            key: spectrum_on_bands(value, wavelength_nm, where=f"layer {self.name}, {key}")
            for key, value in self.explicit.items()
        }
        own = tissue_optics(self.tissue, wavelength_nm, melanin)
        mu_a, g = own.mu_a, given.get("g", own.g)
        if "mu_a_per_mm" in given:
            added = np.asarray(melanin, float)[:, None] - self.tissue.melanosome
            mu_a = given["mu_a_per_mm"] + added * chromophores.melanosome(wavelength_nm)
        mu_s = given.get("mu_s_per_mm", own.mu_s * (1 - own.g) / (1 - g))
        shape = mu_a.shape
        n = given.get("refractive_index", own.refractive_index)
        return LayerOptics(mu_a, np.broadcast_to(mu_s, shape), np.broadcast_to(g, shape), n)


def border_depths(height_mm: Sequence[float]) -> np.ndarray:
    """Depths (K + 1,) of the borders of stacked layers, 0 first.

    Rounded to 1e-12 mm, so that a border has one value whether layers or voxel layers were summed.
    """
    return np.round(np.concatenate([[0.0], np.cumsum(height_mm)]), 12)


def site_layers(site: str) -> tuple[LayerSpec, ...]:
    """The nine layers of a site, top to bottom (optics/data/skin_layers.csv names their sources)."""
    rows = [row for row in read_rows("skin_layers.csv") if row["site"] == site]
    if not rows:
        raise InputError(f"no layers are known for the site {site!r}", remedy="Use forearm or cheek.")
    return tuple(_site_layer(row) for row in rows)


def skin_layers(site: str, overrides: Mapping[str, object], tone: str | None = None) -> tuple[LayerSpec, ...]:
    """The layers of a site in a tone of skin, with a scene's overrides.

    Parameters
    ----------
    tone : see `toned`; None leaves the site's melanin and blood.
    overrides : layer name -> object with the attributes thickness_um, voxel_layers, those of the composition and of
        ``EXPLICIT``, each None where the site's own value stays.
    """
    unknown = set(overrides) - set(LAYER_NAMES)
    if unknown:
        raise InputError(f"there is no layer {min(unknown)!r}", remedy=f"Layers: {', '.join(LAYER_NAMES)}.")
    layers = site_layers(site) if tone is None else toned(site_layers(site), tone)
    return tuple(_overridden(layer, overrides[layer.name]) if layer.name in overrides else layer for layer in layers)


def toned(layers: Sequence[LayerSpec], tone: str) -> tuple[LayerSpec, ...]:
    """Layers with the melanin and blood of a tone (optics/data/skin_tones.csv): factors on the layers' own."""
    rows = [row for row in read_rows("skin_tones.csv") if row["tone"] == tone]
    if not rows:
        raise InputError(f"no tone {tone!r} is known", where="skin.tone")
    basal, upper, blood = (float(rows[0][name]) for name in ("melanin_basal", "melanin_upper", "blood"))
    return tuple(
        replace(layer, tissue=multiplied(layer.tissue, basal if layer.name == "basal" else upper, blood))
        for layer in layers
    )


def multiplied(tissue: Tissue, melanin: float, blood: float) -> Tissue:
    """A tissue with its melanosomes and its blood multiplied, at most to 1."""
    return replace(tissue, melanosome=min(1.0, tissue.melanosome * melanin), blood=min(1.0, tissue.blood * blood))


def slab_layers(described: Sequence[object]) -> tuple[LayerSpec, ...]:
    """Layers of a slab, named ``layer_1``... from the top where they have no name.

    Parameters
    ----------
    described : objects with the attributes name (or None), thickness_mm, voxel_layers and those of ``EXPLICIT``.
    """
    layers = tuple(
        LayerSpec(layer.name or f"layer_{i}", layer.thickness_mm, layer.voxel_layers, explicit=_explicit(layer))
        for i, layer in enumerate(described, 1)
    )
    names = [layer.name for layer in layers]
    for name in names:
        if names.count(name) > 1 or name == "air":
            raise SceneError(f"the layer name {name!r} is taken", key=("slab", "layers"), remedy="Give each its own.")
    return layers


def _site_layer(row: Mapping[str, str]) -> LayerSpec:
    name = _TABLE_NAMES.get(row["layer"], row["layer"])
    tissue = Tissue(
        melanosome=float(row["melanosome"]),
        blood=float(row["blood"]),
        saturation=float(row["S"]),
        vessel_radius_um=float(row["vessel_radius_um"]),
        water=float(row["water"]),
        fat=float(row["fat"]),
        cauchy_a=float(row["n_A"]),
        cauchy_b_nm2=float(row["n_B"]),
        musp_500nm_per_mm=float(row["a_per_cm"]) / 10,
        rayleigh_fraction=float(row["f_ray"]),
        mie_power=float(row["b_mie"]),
    )
    count = RETICULAR_VOXEL_LAYERS.get(row["site"]) if name == "reticular" else None
    return LayerSpec(name, float(row["thickness_um"]) / 1000, count or VOXEL_LAYERS[name], tissue)


def _overridden(layer: LayerSpec, override: object) -> LayerSpec:
    composition = {k: v for k in _COMPOSITION if (v := getattr(override, k)) is not None}
    thickness_um, voxel_layers = override.thickness_um, override.voxel_layers
    try:
        tissue = replace(layer.tissue, **composition)
    except InputError as error:
        raise SceneError(str(error), key=("skin", "layers", layer.name)) from error
    return replace(
        layer,
        thickness_mm=layer.thickness_mm if thickness_um is None else thickness_um / 1000,
        voxel_layers=layer.voxel_layers if voxel_layers is None else voxel_layers,
        tissue=tissue,
        explicit=_explicit(override),
    )


def _explicit(described: object) -> dict[str, float | Mapping[float, float]]:
    return {k: v for k in EXPLICIT if (v := getattr(described, k)) is not None}
