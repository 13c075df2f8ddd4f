"""Small volumes for tests of the walk, and their walks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skinrender.photonmap.light import CollimatedLight, Light, PointLight, SkyLight
from skinrender.photonmap.photon_pass import PhotonPass, Round
from skinrender.skin.volume import SkinVolume
from skinrender.transport import tally


class Layer(NamedTuple):
    """A tissue layer; lengths in mm, coefficients in 1/mm."""

    thickness: float
    mu_a: float
    mu_s: float
    g: float = 0.8
    n: float = 1.4


def slab_volume(
    layers: Sequence[Layer],
    *,
    size: tuple[float, float] = (1.0, 1.0),
    columns: tuple[int, int] = (1, 1),
    planes: Sequence[int] | None = None,
    outside: float = 1.0,
    below: float | None = None,
    sides: str = "periodic",
    fresnel: bool = True,
    surface: np.ndarray | None = None,
) -> SkinVolume:
    """One band of a stack of layers, layer k in planes[k] voxel planes under an optional relief (control points, mm).

    Inner borders refract if `fresnel`. The voxels above the mean plane hold the first layer.
    """
    planes = planes or [1] * len(layers)
    thickness = np.array([layer.thickness for layer in layers])
    border_z = np.concatenate([[0.0], np.cumsum(thickness)])
    edges = [np.linspace(border_z[k], border_z[k + 1], count + 1)[:-1] for k, count in enumerate(planes)]
    edges = np.append(np.concatenate(edges), border_z[-1])
    entry = np.repeat(np.arange(1, len(layers) + 1), planes)
    if surface is not None and surface.min() < 0.0:
        edges, entry = np.append(float(surface.min()), edges), np.append(1, entry)
    n = np.array([outside, *(layer.n for layer in layers)])
    steps = np.flatnonzero(n[1:-1] != n[2:]) if fresnel else ()

    def column(name):
        return np.array([[0.0], *([getattr(layer, name)] for layer in layers)])

    return SkinVolume(
        palette_index=np.broadcast_to(entry.astype(np.uint16), (*columns, entry.size)).copy(),
        z_edges_mm=edges,
        palette_layer=np.arange(len(layers) + 1, dtype=np.uint8),
        palette_melanin=np.zeros(len(layers) + 1, np.float32),
        mu_a=column("mu_a"), mu_s=column("mu_s"), g=column("g"),
        refractive_index=n[:, None],
        wavelength_nm=np.array([550.0]),
        layer_name=("air", *(f"layer_{k + 1}" for k in range(len(layers)))),
        size_mm=size,
        border_z_mm=border_z,
        n_outside=np.array([outside]),
        n_below=np.array([n[-1] if below is None else below]),
        sides=sides,
        surface_mm=None if surface is None else surface.astype(np.float32),
        fresnel_borders=tuple(int(k) for k in steps),
    )  # fmt: skip


def beam(zenith_deg: float = 0.0, azimuth_deg: float = 0.0, radius: float | None = None, position=(0.5, 0.5)) -> Light:
    """Collimated light; flies towards +x at azimuth 0."""
    zenith, azimuth = np.radians([zenith_deg, azimuth_deg])
    direction = np.array([np.sin(zenith) * np.cos(azimuth), np.sin(zenith) * np.sin(azimuth), np.cos(zenith)])
    return CollimatedLight(direction, np.ones(1), radius, np.array(position))


def lamp(x: float = 0.5, y: float = 0.5, height: float = 10.0) -> Light:
    return PointLight(np.array([x, y, -height]), np.ones(1))


def sky() -> Light:
    return SkyLight(np.ones(1))


def walk_rounds(photon_pass: PhotonPass, histories: int, rounds: int = 1, store: bool = False) -> list[Round]:
    """Rounds of one-band histories, the energy of each checked."""
    walked = [photon_pass.walk(index, np.full(photon_pass.bands, histories), store) for index in range(rounds)]
    for one in walked:
        assert_energy(one, len(photon_pass.layer_names))
    return walked


def assert_energy(one: Round, layers: int) -> None:
    """Every emitted photon is reflected, transmitted, gone through a side or absorbed; none is lost."""
    counts = one.tallies
    left, absorbed = counts[:, [tally.REFLECTED, tally.TRANSMITTED, tally.SIDES]], counts[:, tally.absorbed(layers)]
    assert np.array_equal(counts[:, tally.EMITTED], one.emitted)
    assert np.array_equal(left.sum(axis=1) + absorbed.sum(axis=1), one.emitted)
    assert not counts[:, tally.LOST].any()
    assert np.all(counts[:, tally.REFLECTED_UNSCATTERED] <= counts[:, tally.REFLECTED])
    assert np.all(counts[:, tally.SPECULAR] <= counts[:, tally.REFLECTED_UNSCATTERED])
    assert np.all(counts[:, tally.TRANSMITTED_UNSCATTERED] <= counts[:, tally.TRANSMITTED])
    assert len(one.position) == len(one.direction) == one.stored_per_band.sum()


def fractions(walked: list[Round]) -> np.ndarray:
    """Tallies per history (rounds, columns) of the first band, null collisions and border hits left out."""
    ratios = np.array([one.tallies[0] / one.emitted[0] for one in walked])
    return np.delete(ratios, [tally.COLLISIONS_NULL, tally.BORDER_HITS], axis=1)


def furrow(depth_mm: float, width: float = 0.2, samples: int = 100, size: float = 1.0) -> np.ndarray:
    """Control points of a furrow along y in a level surface, with walls as steep as one cell allows."""
    center = (np.arange(samples) + 0.5) * (size / samples)
    inside = np.abs(center - 0.5 * size) < 0.5 * width
    return np.repeat(np.where(inside, depth_mm, 0.0)[:, None], 4, axis=1).astype(np.float32)
