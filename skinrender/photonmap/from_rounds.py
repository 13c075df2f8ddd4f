"""A photon map in memory, of rounds that were just walked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skinrender.photonmap.photon_map import PhotonMap
from skinrender.photonmap.photon_pass import PhotonPass, Round


def map_from_rounds(
    photon_pass: PhotonPass, rounds: Sequence[Round], provenance: Mapping[str, Any] | None = None
) -> PhotonMap:
    """The map that a file of these rounds, one at least, would hold."""
    bands = np.arange(photon_pass.bands, dtype=np.uint8)
    stored = np.array([one.stored_per_band for one in rounds])
    emitted = np.sum([one.emitted for one in rounds], axis=0)
    aimed = np.asarray(photon_pass.power_per_band_aimed)
    return PhotonMap(
        position=np.concatenate([one.position for one in rounds]),
        direction=np.concatenate([one.direction for one in rounds]),
        band=np.repeat(np.tile(bands, len(rounds)), stored.ravel()),
        wavelength_nm=photon_pass.volume.wavelength_nm,
        power_per_band=np.divide(aimed, emitted, out=np.zeros(len(bands)), where=emitted > 0),
        emitted_per_band=emitted,
        round_band_start=np.concatenate([[0], np.cumsum(stored)]),
        bounds_mm=photon_pass.volume.bounds_mm,
        tallies=np.array([one.tallies for one in rounds]),
        layer_name=tuple(photon_pass.layer_names),
        provenance=provenance or {},
        keep_probability=photon_pass.depth_table.keep_probability,
        depth_edges_mm=photon_pass.depth_table.depth_edges_mm,
    )
