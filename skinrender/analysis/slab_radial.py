"""Check of the photon walk against radial profiles of a pencil beam: where, and how steeply, photons leave.

The patch is periodic, so it is made much wider than the profile. Fluence is counted in layers divided at the depths of
the truth's bins: absorbed and scattered = mu_t x path.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np

from skinrender.analysis.slab_stats import Result, events, fraction
from skinrender.analysis.slab_truth import SlabRecord
from skinrender.analysis.slab_walk import (
    MOST_EVENTS,
    ROUNDS,
    Accuracy,
    Means,
    RecordCheck,
    parts,
    record_seed,
    scatterings_per_history,
    stack_scene,
    walked_rounds,
)
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
        counts = RadialCounts(self)
        results = [*self._totals(counts), *self._leaving(counts), *self._fluence(counts)]
        scatterings = int(counts.tallies[tally.scattered(len(self.parts))].sum())
        return RecordCheck(tuple(results), counts.histories, scatterings, time.monotonic() - began)

    def _totals(self, counts: RadialCounts) -> Iterator[Result]:
        for name, expected, column in zip("RT", self.totals, (tally.REFLECTED, tally.TRANSMITTED)):
            yield fraction(self.id, f"{name}_total", expected, 0.0, int(counts.tallies[column]), counts.histories)

    def _leaving(self, counts: RadialCounts) -> Iterator[Result]:
        rings = math.pi * self.dr_mm**2 * (2.0 * np.arange(len(counts.rho)) + 1.0)
        for key, found, units in (("R_rho", counts.rho, rings), ("R_mu", counts.mu, np.ones(len(counts.mu)))):
            for i, (expected, sigma) in enumerate(zip(*self.profiles[key])):
                unit, name = units[i], f"{key}[{i}]"
                yield fraction(self.id, name, expected * unit, sigma * unit, int(found[i]), counts.histories, unit=unit)

    def _fluence(self, counts: RadialCounts) -> Iterator[Result]:
        if any(layer.mu_t == 0.0 for layer in self.stack.layers):
            return
        for i, (expected, sigma) in enumerate(zip(*self.profiles["fluence_z"])):
            got, stderr = counts.fluence.mean[i], counts.fluence.stderr[i]
            yield events(self.id, f"fluence_z[{i}]", expected, sigma, got, stderr, counts.histories)


class RadialCounts:
    """What was counted in the rounds walked for a check of radial profiles; their number is settled beforehand."""

    def __init__(self, check: RadialCheck) -> None:
        scatterings = max(1.0, scatterings_per_history(check.scene, record_seed(check.seed, check.id, 1)))
        per_round = math.ceil(min(1.0 / check.wanted.fraction**2, MOST_EVENTS / scatterings) / ROUNDS)
        self._check, self._layers = check, len(check.parts)
        self._mu_t = np.array([check.stack.layers[i].mu_t for i, *_ in check.parts])
        # the truth's last depth bin holds all that is deeper
        self._bin = np.searchsorted(check.cuts_mm, [0.5 * (top + bottom) for _, top, bottom in check.parts])
        self.histories = per_round * ROUNDS
        self.tallies = np.zeros(tally.columns(self._layers), np.int64)
        self.rho, self.mu = (np.zeros(len(check.profiles[key][0]), np.int64) for key in ("R_rho", "R_mu"))
        self.fluence = Means()
        for walked, exits in walked_rounds(check.scene, record_seed(check.seed, check.id), per_round, ROUNDS):
            self.tallies += walked.tallies[0]
            self._enter_exits(exits[exits[:, 5] > 0.0].astype(np.float64))
            self.fluence.add(self._paths(walked.tallies[0]) / (per_round * check.dz_mm))

    def _enter_exits(self, scattered: np.ndarray) -> None:
        center = 0.5 * self._check.size_mm
        rho = np.hypot(scattered[:, 0] - center, scattered[:, 1] - center)
        self.rho += np.histogram(rho, len(self.rho), (0.0, self._check.dr_mm * len(self.rho)))[0]
        self.mu += np.histogram(-scattered[:, 4], len(self.mu), (0.0, 1.0))[0]

    def _paths(self, tallies: np.ndarray) -> np.ndarray:
        """Length of path in each depth bin, mm, from the collisions there."""
        collided = tallies[tally.absorbed(self._layers)] + tallies[tally.scattered(self._layers)]
        path = np.divide(collided, self._mu_t, out=np.zeros(self._layers), where=self._mu_t > 0.0)
        return np.bincount(self._bin, path, len(self._check.cuts_mm) + 1)
