"""The photon pass (paper, section 7.1): walks the histories of a round through a described volume."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from skinrender.errors import InputError, RunError
from skinrender.photonmap.first_scattering import has_single_term
from skinrender.photonmap.light import CollimatedLight, Light, PointLight
from skinrender.photonmap.photon_map import MAX_BANDS
from skinrender.photonmap.roulette import DepthTable, keep_all, keep_visible
from skinrender.photonmap.stored import StoredPhotons
from skinrender.skin.regions import regions_of
from skinrender.skin.volume import SkinVolume
from skinrender.transport import tally
from skinrender.transport.borders import DIELECTRIC, OPEN, PERIODIC, Borders
from skinrender.transport.emission import collimated_parameters, point_parameters, sky_parameters
from skinrender.transport.gather import MOST_VOXELS
from skinrender.transport.lanes import BAND, SLABS, new_block
from skinrender.transport.launch import Histories
from skinrender.transport.medium import (
    Medium,
    block_type,
    make_grid,
    make_majorant,
    make_medium,
    make_relief,
    stiffness,
)
from skinrender.transport.relief import SAMPLE_BYTES
from skinrender.transport.rng import stream_key
from skinrender.transport.walk import IDLE, IN_FLIGHT, STATE_SIZE, STORED, walk

SIDES = {"periodic": PERIODIC, "open": OPEN, "dielectric": DIELECTRIC}
WALK_STAGE = 0
TILE_MM = 1.0
_BYTES_STORED = 17
"""Of a photon in memory: position, direction and band."""
ENDLESS = 1 << 35
"""Flights without the end of a history after which a walk is given up: some minutes."""


@dataclass(frozen=True, eq=False)
class Round:
    """Photons and counts of one round; n photons, B bands.

    Parameters
    ----------
    index : of the round.
    emitted : (B,) i8, histories.
    tallies : (B, T) i8, columns of `transport.tally`.
    position : (n, 3) f4, mm, and direction : (n, 2) u2, octahedral, in band order.
    stored_per_band : (B,) i8.
    """

    index: int
    emitted: np.ndarray
    tallies: np.ndarray
    position: np.ndarray
    direction: np.ndarray
    stored_per_band: np.ndarray


def round_memory_bytes(stored: float) -> float:
    """Most that `PhotonPass.walk` holds of a round's photons: as they were walked, with room for more, and in order."""
    return 2.5 * _BYTES_STORED * stored


def pass_bytes(volume: SkinVolume) -> int:
    """Most memory that a `PhotonPass` takes beside its volume: the voxels without air and as bricks, what collisions read,
    the borders' cells."""
    fields = [field for field in regions_of(volume).heights_mm if field is not None]
    rows = 16 * SLABS * volume.mu_a.size
    return 4 * volume.palette_index.nbytes + rows + 2 * SAMPLE_BYTES * sum(field.size for field in fields)


class PhotonPass:
    """Walks rounds of a volume under a light; prepares the bands once.

    Parameters
    ----------
    volume, light : what is lit and by what.
    seed : of the histories; a history is a pure function of (seed, band, index).
    roulette : thin out deep photons that no view ray can see.
    real : number type of the blocks; by default float32 where that resolves the volume.
    """

    def __init__(
        self, volume: SkinVolume, light: Light, seed: int, *, roulette: bool = False, real: type | None = None
    ):
        if len(volume.wavelength_nm) > MAX_BANDS:
            raise InputError(f"{len(volume.wavelength_nm)} bands; a photon map holds {MAX_BANDS}")
        self.real = real
        self.volume = volume
        self.light = light
        self.seed = seed
        self.layer_names = volume.layer_name[1:]
        self.power_per_band_aimed = light.power_aimed_per_band(volume.size_mm)
        self.depth_table: DepthTable = (keep_visible if roulette else keep_all)(volume)
        self._medium = lru_cache(maxsize=2)(self._make_medium)
        self._majorant = lru_cache(maxsize=None)(self._make_majorant)
        self._expected = 0  # photons of the round before: the next one's arrays begin as large

    def seeded(self, seed: int) -> PhotonPass:
        """The same pass with another seed; they share what is prepared."""
        other = copy.copy(self)
        other.seed = seed
        other.__dict__.pop("_keys", None)
        return other

    def prepare(self) -> PhotonPass:
        """This pass with all that its walks share made, before threads would each make it."""
        for real, bands in self._number_types():
            if bands.any():
                self._medium(real)
        return self

    @property
    def bands(self) -> int:
        return len(self.volume.wavelength_nm)

    @cached_property
    def _z_edges(self) -> np.ndarray:
        return np.asarray(self.volume.z_edges_mm - self.volume.z_edges_mm[0], dtype=np.float64)

    @cached_property
    def _regions(self):
        return regions_of(self.volume)

    @cached_property
    def _relief(self):
        z_top = self.volume.z_edges_mm[0]
        fields = [field - np.float32(z_top) for field in self._regions.heights_mm if field is not None]
        return make_relief(fields, self.volume.size_mm)

    @cached_property
    def _borders(self) -> Borders:
        regions = self._regions
        z = regions.border_z_mm - self.volume.z_edges_mm[0]
        is_rough = np.array([field is not None for field in regions.heights_mm])
        rough = np.where(is_rough, np.cumsum(is_rough) - 1, -1)
        safe_top, safe_bottom = z.copy(), np.append(z[1:], z[-1])
        for k in np.flatnonzero(is_rough):
            cells = self._relief.bounds[rough[k]]
            safe_top[k] = cells[..., 1].max()
            if k > 0:
                safe_bottom[k - 1] = cells[..., 0].min()
        table = np.column_stack([z, rough, safe_top, safe_bottom])
        lx, ly = map(float, self.volume.size_mm)
        return Borders(table, np.ascontiguousarray(regions.index.T), lx, ly, SIDES[self.volume.sides])

    def stiffness(self, band: int) -> str | None:
        """Why a band is walked in float64; None where float32 will do."""
        return stiffness(self._majorant(band)[0], self._z_edges)

    def _make_majorant(self, band: int) -> tuple[np.ndarray, np.ndarray]:
        return make_majorant(self._plane_mu_t(band), self._z_edges)

    def _plane_mu_t(self, band: int) -> np.ndarray:
        """Largest extinction of each plane, 1/mm."""
        mu_t = self.volume.mu_a[:, band] + self.volume.mu_s[:, band]
        return np.where(self.volume.plane_holds_tissue, mu_t, 0.0).max(axis=1)

    def _make_medium(self, real: type) -> Medium:
        v = self.volume
        layer = np.maximum(v.palette_layer.astype(np.int32) - 1, 0)
        grid, majorants = make_grid(v.tissue_index, self._z_edges, real), list(map(self._majorant, range(self.bands)))
        if grid.palette.size > MOST_VOXELS:
            raise InputError(
                f"{grid.palette.size} voxels where tissue varies sideways; a walk can tell {MOST_VOXELS} apart",
                remedy="Use wider columns, or fewer voxel layers",
            )
        return make_medium(
            grid, majorants, v.mu_a, v.mu_s, v.g, layer, len(self.layer_names), self._borders, self._z_edges, v.shape[:2],
            v.z_edges_mm[0], real,
        )  # fmt: skip

    @cached_property
    def _in_double(self) -> np.ndarray:
        """(B,) whether a band is walked in float64."""
        return np.array([
            (self.real or block_type(self._majorant(band)[0], self._z_edges)) is np.float64 for band in range(self.bands)
        ])  # fmt: skip

    @cached_property
    def _lamp(self) -> tuple[float, ...]:
        z_top = float(self.volume.z_edges_mm[0])
        light = self.light
        if isinstance(light, PointLight):
            x, y, z = light.position_mm
            return point_parameters((x, y, z - z_top), self.volume.size_mm, -z_top)
        if isinstance(light, CollimatedLight):
            return collimated_parameters(light.position_mm, light.direction, light.radius_mm)
        return sky_parameters()

    def walk(self, index: int, histories: np.ndarray, store: bool, exits: list | None = None) -> Round:
        """Walk one round.

        Parameters
        ----------
        index : of the round; its histories are those from ``index * histories[band]`` on.
        histories : (B,) of each band.
        store : keep the scattering events, not only their counts.
        exits : receives, for each band with histories, an (n, 6) float32 array x, y, ux, uy, uz, scattered of the photons
            that left upwards.
        """
        histories = np.array(histories, dtype=np.int64)
        tallies = np.zeros((self.bands, tally.columns(len(self.layer_names))), dtype=np.int64)
        photons = StoredPhotons(self._expected) if store else None
        left = None if exits is None else np.zeros((histories.sum(), 6), np.float32)
        for real, bands in self._number_types():
            if histories[bands].any():
                self._walk(real, self._source(index, histories, bands), photons, tallies, left)
        if exits is not None:
            gone = tallies[:, tally.REFLECTED] - tallies[:, tally.SPECULAR]
            of_bands = np.split(left, np.cumsum(histories)[:-1])
            exits.extend(of_bands[band][: gone[band]] for band in np.flatnonzero(histories))
        if photons is None:
            position, direction, stored = np.empty((0, 3), "f4"), np.empty((0, 2), "u2"), np.zeros(self.bands, np.int64)
        else:
            position, direction, stored = photons.in_band_order(self.bands)
            self._expected = photons.count
        return Round(index, histories, tallies, position, direction, stored)

    @cached_property
    def _keys(self) -> np.ndarray:
        """(B,) of the generators of each band's histories."""
        return np.array([stream_key(self.seed, band, WALK_STAGE) for band in range(self.bands)])

    def _number_types(self) -> tuple[tuple[type, np.ndarray], ...]:
        """Types of the block, each with the bands (B,) bool that are walked in it."""
        return (np.float32, ~self._in_double), (np.float64, self._in_double)

    def _source(self, index: int, histories: np.ndarray, bands: np.ndarray) -> Histories:
        """The histories of a round in the bands (B,) bool."""
        tiles_x, tiles_y = np.maximum(1, np.ceil(np.array(self.volume.size_mm) / TILE_MM)).astype(int).tolist()
        return Histories(
            self._keys, index * histories, np.where(bands, histories, 0), np.cumsum(histories) - histories,
            tiles_x, tiles_y, self._lamp, -float(self.volume.z_edges_mm[0]), not has_single_term(self.volume, self.light),
        )  # fmt: skip

    def _walk(
        self, real: type, source: Histories, photons: StoredPhotons | None, counts: np.ndarray, left: np.ndarray | None
    ) -> None:
        medium, keep = self._medium(real), self.depth_table.thresholds
        tallies = np.zeros((tally.WAYS, *counts.shape), dtype=np.int64)
        (f, w), arrivals = new_block(real), new_block(real)
        state = np.zeros(STATE_SIZE, dtype=np.int64)
        arrays = None
        while True:
            if photons is not None:
                photons.make_room()
                arrays, state[STORED] = photons.arrays, photons.count
            walk(f, w, arrivals, source, medium, self._relief, keep, arrays, tallies, left, state)
            if photons is not None:
                photons.count = int(state[STORED])
            if state[IN_FLIGHT] == 0:
                break
            if state[IDLE] > ENDLESS:
                raise RunError(
                    f"at {self.volume.wavelength_nm[w[BAND]]:g} nm photons hardly ever end: none has in "
                    f"{ENDLESS:.1g} flights\n"
                    "  give the tissue some absorption, or make it thinner or clearer"
                )
        counts += tallies.sum(axis=0)
