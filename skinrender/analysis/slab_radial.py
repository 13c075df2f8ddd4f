"""Check of the photon walk against radial profiles of a pencil beam: where, and how steeply, photons leave.

The patch is periodic, so it is made much wider than the profile. Fluence is counted in layers divided at the depths of
the truth's bins: absorbed and scattered = mu_t x path.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np

from skinrender.analysis.slab_fields import PILOT_HISTORIES, ROUNDS, Means
from skinrender.analysis.slab_stats import Result, events, fraction
from skinrender.analysis.slab_truth import SlabRecord
from skinrender.analysis.slab_walk import Accuracy, MOST_EVENTS, RecordCheck, parts, record_seed, stack_scene
from skinrender.engine.ledger import check_counts
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.skin.builder import build_volume
from skinrender.transport import tally

PATCH_RANGES = 10.0
"""Side of the patch in ranges of the profile."""


class RadialCheck:
    """Check of a record of radial profiles.

    Raises `InputError` if the record lacks a value or no scene can be made of it.
    """

    def __init__(self, record: SlabRecord, seed: int, wanted: Accuracy) -> None:
        if record.stack.incidence != "normal":
            raise record.wrong("incidence", "is not normal", "a pencil beam falls straight down")
        self.id, self.seed, self.wanted, self.stack = record.id, seed, wanted, record.stack
        self.totals = [record.number(f"{name}_total_exact", 0.0, 1.0) for name in "RT"]
        self.dr_mm, self.dz_mm = (record.number(key, low=1e-9) for key in ("dr_mm", "dz_mm"))
        self.profiles = {key: self._profile(record, key) for key in ("R_rho", "R_mu", "fluence_z")}
        self.size_mm = PATCH_RANGES * self.dr_mm * len(self.profiles["R_rho"][0])
        self.cuts_mm = [self.dz_mm * i for i in range(1, len(self.profiles["fluence_z"][0]))]
        self.parts = parts(self.stack, self.cuts_mm)
        self.scene = stack_scene(record, cuts_mm=self.cuts_mm, size_mm=self.size_mm, pencil=True)

    @staticmethod
    def _profile(record: SlabRecord, key: str) -> tuple[np.ndarray, np.ndarray]:
        values = record.numbers(key, low=0.0)
        return np.array(values), np.array(record.numbers(f"{key}_sigma", len(values), 0.0))

    @property
    def cost(self) -> float:
        path = float(self.profiles["fluence_z"][0].sum()) * self.dz_mm
        return (1.0 + path * max(layer.mu_t for layer in self.stack.layers)) / self.wanted.fraction**2

    def __call__(self) -> RecordCheck:
        began = time.monotonic()
        walked = RadialWalk(self)
        results = [*self._totals(walked), *self._leaving(walked), *self._fluence(walked)]
        scatterings = int(walked.counts[tally.scattered(len(self.parts))].sum())
        return RecordCheck(tuple(results), walked.histories, scatterings, time.monotonic() - began)

    def _totals(self, walked: RadialWalk) -> Iterator[Result]:
        for name, expected, column in zip("RT", self.totals, (tally.REFLECTED, tally.TRANSMITTED)):
            yield fraction(self.id, f"{name}_total", expected, 0.0, int(walked.counts[column]), walked.histories)

    def _leaving(self, walked: RadialWalk) -> Iterator[Result]:
        rings = math.pi * self.dr_mm**2 * (2.0 * np.arange(len(walked.rho)) + 1.0)
        for key, counts, areas in (("R_rho", walked.rho, rings), ("R_mu", walked.mu, np.ones(len(walked.mu)))):
            for i, (expected, sigma) in enumerate(zip(*self.profiles[key])):
                share, error = float(expected * areas[i]), float(sigma * areas[i])
                row = fraction(self.id, "", share, error, int(counts[i]), walked.histories)
                values = (float(expected), row.got / areas[i], row.stderr / areas[i])
                yield Result(self.id, f"{key}[{i}]", *map(float, values), row.z)

    def _fluence(self, walked: RadialWalk) -> Iterator[Result]:
        if any(layer.mu_t == 0.0 for layer in self.stack.layers):
            return
        for i, (expected, sigma) in enumerate(zip(*self.profiles["fluence_z"])):
            got, stderr = (float(value[i]) for value in (walked.fluence.mean, walked.fluence.stderr))
            yield events(self.id, f"fluence_z[{i}]", float(expected), float(sigma), got, stderr, walked.histories)


class RadialWalk:
    """The rounds walked for a check of radial profiles, with what was counted in them."""

    def __init__(self, check: RadialCheck) -> None:
        volume, light = build_volume(check.scene), light_from_scene(check.scene)
        self._check, self._layers = check, len(check.parts)
        self._mu_t = np.array([check.stack.layers[i].mu_t for i, *_ in check.parts])
        # the truth's last depth bin holds all that is deeper
        self._bin = np.searchsorted(check.cuts_mm, [0.5 * (top + bottom) for _, top, bottom in check.parts])
        pilot = PhotonPass(volume, light, record_seed(check.seed, check.id, 1))
        scattered = pilot.walk(0, np.array([PILOT_HISTORIES]), False).tallies[0, tally.scattered(self._layers)].sum()
        wanted = min(1.0 / check.wanted.fraction**2, MOST_EVENTS / max(1.0, scattered / PILOT_HISTORIES))
        per_round = math.ceil(wanted / ROUNDS)
        self.histories = per_round * ROUNDS
        self.counts = np.zeros(tally.columns(self._layers), np.int64)
        self.rho, self.mu = (np.zeros(len(check.profiles[key][0]), np.int64) for key in ("R_rho", "R_mu"))
        self.fluence = Means()
        photon_pass = PhotonPass(volume, light, record_seed(check.seed, check.id))
        for index in range(ROUNDS):
            self._enter(photon_pass, index, per_round)

    def _enter(self, photon_pass: PhotonPass, index: int, histories: int) -> None:
        left: list[np.ndarray] = []
        walked = photon_pass.walk(index, np.array([histories]), False, left)
        check_counts(walked)
        counts = walked.tallies[0]
        self.counts += counts
        scattered = left[0][left[0][:, 5] > 0.0].astype(np.float64)
        center = 0.5 * self._check.size_mm
        rho = np.hypot(scattered[:, 0] - center, scattered[:, 1] - center)
        self.rho += np.histogram(rho, len(self.rho), (0.0, self._check.dr_mm * len(self.rho)))[0]
        self.mu += np.histogram(-scattered[:, 4], len(self.mu), (0.0, 1.0))[0]
        collided = counts[tally.absorbed(self._layers)] + counts[tally.scattered(self._layers)]
        path = np.divide(collided, self._mu_t, out=np.zeros(self._layers), where=self._mu_t > 0.0)
        self.fluence.add(np.bincount(self._bin, path, len(self._check.cuts_mm) + 1) / (histories * self._check.dz_mm))
