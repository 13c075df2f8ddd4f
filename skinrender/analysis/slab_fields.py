"""Check of the photon walk against fields in layered slabs: fluence, net flux and radiance against depth.

Three views of one walk. Fluence and net flux are counted: layers are divided about each depth, and what is absorbed
and scattered in the thin part about it is mu_t x fluence x thickness, what is absorbed below it or transmitted is the
net flux through it. Radiance inside is that of the stored photons about the depth, by the direction they came from;
radiance outside is that of the photons that leave. First scatterings of the straight light are not stored, just as
truth's radiance leaves the unscattered light out.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np

from skinrender.analysis.slab_bins import (
    COSINES,
    Bin,
    cosine_bin,
    critical_cosines,
    depth_bins,
    unscattered_return,
    vertical_cosine,
)
from skinrender.analysis.slab_stats import Result, events, fraction
from skinrender.analysis.slab_truth import SlabRecord, TruthRecord
from skinrender.analysis.slab_walk import (
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

STORED_PER_ROUND = 3e6
"""Bounds the memory of a round: 50 MB of photons."""
MOST_STORED = 4e9
CLEAN = 1e-4
"""Largest part of unscattered light sent back inside at which stored photons pass for scattered light."""
DEPTH_COLUMNS = ["z_mm", "layer", "fluence_total", "fluence_unscattered", "flux_down", "flux_up"]


class FieldCheck:
    """Check of a record of fields.

    Raises `InputError` if the record lacks a value or no scene can be made of it.
    """

    def __init__(self, record: SlabRecord, seed: int, wanted: Accuracy) -> None:
        self.id, self.seed, self.wanted, self.stack = record.id, seed, wanted, record.stack
        self.totals = [record.number(name, 0.0, 1.0) for name in ("R_total", "T_total")]
        self.accuracy = {name: record.accuracy(f"{name}_rel") for name in ("depth", "exit", "radiance")}
        self._read_depth(record)
        self.exit_mu = _cosines(record, "exit_mu")
        self.exit_radiance = np.array(record.numbers("exit_radiance_top", len(self.exit_mu), 0.0))
        self._read_radiance(record)
        self.bins = depth_bins(self.stack, self.z_mm, self.layer, self.fluence)
        cuts_mm = [float(edge) for z, about in zip(self.z_mm, self.bins) for edge in (about.low, z, about.high)]
        self.parts = parts(self.stack, cuts_mm)
        self.scene = stack_scene(record, cuts_mm=cuts_mm)

    def _read_depth(self, record: SlabRecord) -> None:
        columns = record.get("depth_columns", list, f"{DEPTH_COLUMNS}")
        if columns != DEPTH_COLUMNS:
            raise record.wrong("depth_columns", f"are {columns}", f"expected {DEPTH_COLUMNS}")
        rows = sorted(record.number_rows("depth", len(DEPTH_COLUMNS)))
        borders = self.stack.depth_mm
        for z, layer, *_ in rows:
            if layer not in range(len(borders) - 1) or not borders[int(layer)] < z < borders[int(layer) + 1]:
                raise record.wrong("depth", f"has {z:g} mm in layer {layer:g}", "name the layer that holds the depth")
        self.z_mm = [row[0] for row in rows]
        if len(set(self.z_mm)) < len(rows):
            raise record.wrong("depth", "has a depth twice", "write each depth once")
        self.layer = [int(row[1]) for row in rows]
        self.fluence = np.array([row[2] for row in rows])
        self.net_flux = [row[4] - row[5] for row in rows]

    def _read_radiance(self, record: SlabRecord) -> None:
        section = record.section("radiance")
        self.mu = _cosines(section, "mu")
        self.radiance: list[tuple[int, np.ndarray, np.ndarray]] = []
        for i, (z, down, up) in enumerate(section.rows("rows", 3)):
            row = TruthRecord({"z_mm": z, "down": down, "up": up}, f"{section.where}: rows[{i}]")
            if row.number("z_mm") not in self.z_mm:
                raise row.wrong("z_mm", f"is {z:g}", "give a depth that `depth` has")
            both = (np.array(row.numbers(side, len(self.mu), 0.0)) for side in ("down", "up"))
            self.radiance.append((self.z_mm.index(z), *both))

    @property
    def cost(self) -> float:
        path = float(np.trapezoid(self.fluence, self.z_mm))
        return (1.0 + path * max(layer.mu_t for layer in self.stack.layers)) / self.wanted.fraction**2

    def __call__(self) -> RecordCheck:
        began = time.monotonic()
        counts = FieldCounts(self)
        results = [*self._totals(counts), *self._depths(counts), *self._exits(counts), *self._inside(counts)]
        scatterings = int(counts.tallies[tally.scattered(len(self.parts))].sum())
        return RecordCheck(tuple(results), counts.histories, scatterings, time.monotonic() - began)

    def _totals(self, counts: FieldCounts) -> Iterator[Result]:
        for name, expected, column in zip(("R_total", "T_total"), self.totals, (tally.REFLECTED, tally.TRANSMITTED)):
            accuracy = self.accuracy["depth"] * expected
            yield fraction(self.id, name, expected, accuracy, int(counts.tallies[column]), counts.histories)

    def _depths(self, counts: FieldCounts) -> Iterator[Result]:
        absorbed, accuracy = counts.tallies[tally.absorbed(len(self.parts))], self.accuracy["depth"]
        for i, (z, about) in enumerate(zip(self.z_mm, self.bins)):
            unit = self.stack.layers[self.layer[i]].mu_t * about.width
            if unit > 0.0:
                expected, got, stderr = self.fluence[i] * unit, counts.collisions.mean[i], counts.collisions.stderr[i]
                name = f"fluence_total[{i}]"
                yield events(self.id, name, expected, accuracy * expected, got, stderr, counts.histories, unit=unit)
            below = sum(int(count) for count, part in zip(absorbed, self.parts) if part[1] >= z)
            count = below + int(counts.tallies[tally.TRANSMITTED])
            expected = min(1.0, max(0.0, self.net_flux[i]))
            yield fraction(self.id, f"flux_net[{i}]", expected, accuracy, count, counts.histories)

    def _exits(self, counts: FieldCounts) -> Iterator[Result]:
        for k, about in self.exit_bins.items():
            unit = math.pi * (about.high**2 - about.low**2)
            expected, name = self.exit_radiance[k] * unit, f"exit_radiance_top[{k}]"
            accuracy = self.accuracy["exit"] * expected
            yield fraction(self.id, name, expected, accuracy, int(counts.exits[k]), counts.histories, unit=unit)

    def _inside(self, counts: FieldCounts) -> Iterator[Result]:
        for column, (row, side, k, about) in enumerate(self.radiance_bins):
            i = self.radiance[row][0]
            unit = self.stack.layers[self.layer[i]].mu_s * self.bins[i].width * 2.0 * math.pi * about.width
            expected, name = self.radiance[row][1 + side][k] * unit, f"radiance_{('down', 'up')[side]}[{row}][{k}]"
            got, stderr = counts.inside.mean[column], counts.inside.stderr[column]
            accuracy = self.accuracy["radiance"] * expected
            yield events(self.id, name, expected, accuracy, got, stderr, counts.histories, unit=unit)

    @property
    def exit_bins(self) -> dict[int, Bin]:
        """Bins of the outside cosine, by index; flux per cosine is what is even over a bin."""
        flux = self.exit_radiance * self.exit_mu
        bins = {k: cosine_bin(self.exit_mu, flux, k) for k in np.flatnonzero(flux > 0.0).tolist()}
        return {k: about for k, about in bins.items() if about is not None}

    @property
    def radiance_bins(self) -> list[tuple[int, int, int, Bin]]:
        """Bins of stored photons: row, side (0 down, 1 up), cosine, interval of |cosine|.

        Left out: the direction of the beam itself, layers that don't scatter, cosines near the critical ones of total
        reflection, where radiance has an edge, and stacks in which unscattered diffuse light comes back from below.
        """
        if self.stack.incidence == "diffuse" and unscattered_return(self.stack) > CLEAN:
            return []
        found = []
        for row, (i, *both) in enumerate(self.radiance):
            edges = critical_cosines(self.stack, self.layer[i])
            for side, values in enumerate(both):
                for k in np.flatnonzero((values > 0.0) & (self.mu < 1.0)).tolist():
                    about = cosine_bin(self.mu, values, k)
                    if about is None or self.stack.layers[self.layer[i]].mu_s == 0.0:
                        continue
                    if not any(about.low - COSINES < edge < about.high + COSINES for edge in edges):
                        found.append((row, side, k, about))
        return found


def _cosines(record: TruthRecord, key: str) -> np.ndarray:
    cosines = np.array(record.numbers(key, low=1e-3, high=1.0))
    if np.any(np.diff(cosines) <= 0.0):
        raise record.wrong(key, "don't ascend", "sort the cosines and what belongs to them")
    return cosines


class FieldCounts:
    """What was counted in the rounds walked for a check of fields.

    The number of histories is settled beforehand; a pilot tells how many photons each of them stores.
    """

    def __init__(self, check: FieldCheck) -> None:
        stored = max(1.0, scatterings_per_history(check.scene, record_seed(check.seed, check.id, 1)))
        wanted = min(1.0 / check.wanted.fraction**2, MOST_STORED / stored)
        rounds = max(ROUNDS, math.ceil(wanted * stored / STORED_PER_ROUND))
        per_round = math.ceil(wanted / rounds)
        self._layers, self._check = len(check.parts), check
        self._exit_bins, self._radiance_bins = check.exit_bins, check.radiance_bins
        self.histories = per_round * rounds
        self.tallies = np.zeros(tally.columns(self._layers), np.int64)
        self.exits = np.zeros(len(check.exit_mu), np.int64)
        self.collisions, self.inside = Means(), Means()
        seed = record_seed(check.seed, check.id)
        for walked, exits in walked_rounds(check.scene, seed, per_round, rounds, store=True):
            self._enter(walked.tallies[0], exits)
            self.inside.add(self._directions(walked.position[:, 2], walked.direction) / per_round)
            self.collisions.add(self._collisions(walked.tallies[0]) / per_round)

    def _enter(self, tallies: np.ndarray, exits: np.ndarray) -> None:
        self.tallies += tallies
        cosine = -exits[exits[:, 5] > 0.0, 4]
        for k, about in self._exit_bins.items():
            self.exits[k] += np.count_nonzero((cosine > about.low) & (cosine <= about.high))

    def _collisions(self, tallies: np.ndarray) -> np.ndarray:
        """Photons absorbed or scattered about each depth."""
        collided = tallies[tally.absorbed(self._layers)] + tallies[tally.scattered(self._layers)]
        upper, lower = np.array([[top, bottom] for _, top, bottom in self._check.parts]).T
        return np.array([collided[(upper >= about.low) & (lower <= about.high)].sum() for about in self._check.bins])

    def _directions(self, z: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Stored photons in each bin of radiance."""
        cosines = {}
        for row in {row for row, *_ in self._radiance_bins}:
            about = self._check.bins[self._check.radiance[row][0]]
            cosines[row] = np.sort(vertical_cosine(direction[(z >= about.low) & (z < about.high)]))
        found = []
        for row, side, _, about in self._radiance_bins:
            edges = (about.low, about.high) if side == 0 else (-about.high, -about.low)
            found.append(np.diff(np.searchsorted(cosines[row], edges))[0])
        return np.array(found, float)
