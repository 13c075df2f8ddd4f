"""Photon maps made in memory, for tests of the estimates."""

from __future__ import annotations

import numpy as np

from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_map import PhotonMap
from skinrender.photonmap.photon_pass import PhotonPass


def walk_map(scene, volume, histories: int, rounds: int = 32, seed: int = 1) -> PhotonMap:
    """A map of `rounds` rounds of `histories` in every band."""
    walk = PhotonPass(volume, light_from_scene(scene), seed, roulette=scene.photons.roulette)
    walked = [walk.walk(k, np.full(walk.bands, histories), True) for k in range(rounds)]
    stored = np.concatenate([one.stored_per_band for one in walked])
    emitted = np.full(walk.bands, histories * rounds)
    table = walk.depth_table
    return PhotonMap(
        position=np.concatenate([one.position for one in walked]),
        direction=np.concatenate([one.direction for one in walked]),
        band=np.repeat(np.tile(np.arange(walk.bands, dtype=np.uint8), rounds), stored),
        wavelength_nm=volume.wavelength_nm,
        power_per_band=walk.power_per_band_aimed / emitted,
        emitted_per_band=emitted,
        round_band_start=np.concatenate([[0], np.cumsum(stored)]),
        bounds_mm=volume.bounds_mm,
        tallies=np.array([one.tallies for one in walked]),
        layer_name=walk.layer_names,
        provenance={},
        keep_probability=table.keep_probability,
        depth_edges_mm=table.depth_edges_mm,
    )
