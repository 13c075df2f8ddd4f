"""The estimate in parts of some bands each, so that a cluster can share it.

Bands are independent until their light is joined, so a part needs no photons but its own, and the picture does not
depend on who estimated which: its spectra are those of `View.scattered` to the last bit, `stderr.Y` to rounding, as
batches are filtered part by part.
"""

from __future__ import annotations

import threading
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skinrender.engine.executor import in_order
from skinrender.engine.recipe import VolumeFile
from skinrender.engine.view import View, photons_bar
from skinrender.estimate.scatter_image import BandsLight, ScatteredLight
from skinrender.estimate.stream import DepthSample, sample_depths
from skinrender.photonmap.photon_map import PhotonMap
from skinrender.skin.volume import load_volume

if TYPE_CHECKING:
    from skinrender.engine.cluster import Cluster

PART_PHOTONS = 8_000_000
"""Photons of a part, 130 MB on the way to a worker; a band with more is a part of its own."""
_view: tuple[str, View] | None = None
"""Of a worker: what its last view was made of, and the view."""
_one_builds = threading.Lock()


def scattered_apart(
    cluster: Cluster, view: View, photon_map: PhotonMap, volume_file: VolumeFile, progress: bool = True
) -> ScatteredLight:
    """The multiply scattered light that a map shows, its bands estimated by the workers of a cluster.

    volume_file : the view's volume.
    """
    parts = parts_of(photon_map)
    work = ShowBands(
        view.scene, view.method, view.gather_count, volume_file, photon_map, sample_depths(photon_map), parts
    )
    lights, stored = [], stored_per_band(photon_map)
    done = in_order(work, range(len(parts)), workers=cluster.slots, open_executor=cluster.open_executor)
    with closing(done), photons_bar(len(photon_map), view.method, progress) as bar:
        for light in done:
            lights.append(light)
            bar.update(int(stored[light.bands].sum()))
    return view.joined(lights, photon_map.rounds)


def parts_of(photon_map: PhotonMap) -> tuple[np.ndarray, ...]:
    """Consecutive bands, as many as hold `PART_PHOTONS` together."""
    parts, held = [[]], 0
    for band, stored in enumerate(stored_per_band(photon_map)):
        if parts[-1] and held + stored > PART_PHOTONS:
            parts.append([])
            held = 0
        parts[-1].append(band)
        held += stored
    return tuple(np.array(part) for part in parts)


def stored_per_band(photon_map: PhotonMap) -> np.ndarray:
    """(B,) photons of each band in all rounds."""
    return np.diff(photon_map.round_band_start).reshape(photon_map.rounds, -1).sum(axis=0)


@dataclass(frozen=True, eq=False)
class ShowBands:
    """Estimate the parts of a picture, by number.

    Parameters
    ----------
    scene, method, gather_count : of the view.
    volume_file : the volume's.
    photon_map, depths : the whole map and its `sample_depths`; a worker gets the photons of its part.
    parts : bands of each part.
    """

    scene: Any
    method: str
    gather_count: int | None
    volume_file: VolumeFile
    photon_map: PhotonMap
    depths: DepthSample
    parts: tuple[np.ndarray, ...]

    def finished(self, index: int) -> None:
        """Nothing of a picture is kept from an earlier run."""

    def errand(self, index: int) -> BandsErrand:
        """What a worker is sent."""
        bands = self.parts[index]
        return BandsErrand(
            self.scene, self.method, self.gather_count, self.volume_file.digest, self.photon_map.of_bands(bands),
            self.depths, bands,
        )  # fmt: skip

    def keep(self, light: BandsLight) -> BandsLight:
        """What comes back, as it is."""
        return light


@dataclass(frozen=True, eq=False)
class BandsErrand:
    """A part of a picture, on its way to a worker; `photon_map` holds the photons of its bands."""

    scene: Any
    method: str
    gather_count: int | None
    volume_digest: str
    photon_map: PhotonMap
    depths: DepthSample
    bands: np.ndarray

    def __call__(self, volume_path: Path) -> BandsLight:
        """Estimate the part, in the volume that lies there."""
        return self._view(volume_path).of_bands(self.photon_map, self.depths, self.bands, lambda photons: None)

    def _view(self, volume_path: Path) -> View:
        """The one used last is kept, so a process follows the view rays once; its threads take a part each."""
        global _view
        key = f"{self.volume_digest} {self.method} {self.gather_count} {self.scene.model_dump_json()}"
        with _one_builds:
            if _view is None or _view[0] != key:
                view = View(self.scene, load_volume(volume_path), self.method, self.gather_count, threads=1)
                view.prepare_for_photons()  # before other threads ask for it
                _view = (key, view)
            return _view[1]
