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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass


import numpy as np

from skinrender.analysis.slab_stats import Result, events, fraction
from skinrender.analysis.slab_truth import Layer, SlabRecord
from skinrender.analysis.slab_walk import Accuracy, RecordCheck, parts, record_seed, stack_scene
from skinrender.engine.ledger import Batches, check_counts
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.skin.builder import build_volume
from skinrender.transport import tally

ROUNDS = 128
STORED_PER_ROUND = 3e6
"""Bounds the memory of a round: 50 MB of photons."""
PILOT_HISTORIES = 512
MOST_STORED = 4e9
FREE_PATHS = 0.05
COSINES = 0.02
"""Widest half widths of the bins about a depth (in mean free paths) and about a cosine."""
BIN_BIAS = 1e-3
"""Allowed relative difference between the mean over a bin and the value in its middle."""
CLEAN = 1e-4
"""Largest share of unscattered light reflected inside at which stored photons count as scattered light."""
_DEPTH_COLUMNS = ["z_mm", "layer", "fluence_total", "fluence_unscattered", "flux_down", "flux_up"]


@dataclass(frozen=True)
class Bin:
    """An interval about a value of a coordinate."""

    low: float
    high: float

    @property
    def width(self) -> float:
        return self.high - self.low


class FieldCheck:
    """Check of a record of fields.

    Raises `InputError` if the record lacks a value or no scene can be made of it.
    """

    def __init__(self, record: SlabRecord, seed: int, wanted: Accuracy) -> None:
        self.id, self.seed, self.wanted, self.stack = record.id, seed, wanted, record.stack
        self.totals = [record.number(name, 0.0, 1.0) for name in ("R_total", "T_total")]
        columns = record.get("depth_columns", list, f"{_DEPTH_COLUMNS}")
        if columns != _DEPTH_COLUMNS:
            raise record.wrong("depth_columns", f"are {columns}", f"expected {_DEPTH_COLUMNS}")
        self._read_depth(record)
        self.exit_mu = np.array(record.numbers("exit_mu", low=1e-3, high=1.0))
        self.exit_radiance = np.array(record.numbers("exit_radiance_top", len(self.exit_mu), 0.0))
        self._read_radiance(record)
        self.accuracy = {name: record.accuracy(f"{name}_rel") for name in ("depth", "exit", "radiance")}
        self.bins = depth_bins(self.stack.layers, self.stack.depth_mm, self.z, self.layer, self.fluence)
        cuts = [edge for z, about in zip(self.z, self.bins) for edge in (about.low, z, about.high)]
        self.parts = parts(self.stack, cuts)
        self.scene = stack_scene(record, cuts_mm=cuts)

    def _read_depth(self, record: SlabRecord) -> None:
        rows = sorted(record.number_rows("depth", 6))
        self.z = [row[0] for row in rows]
        self.layer = [int(row[1]) for row in rows]
        self.fluence = np.array([row[2] for row in rows])
        self.net_flux = [row[4] - row[5] for row in rows]
        borders = self.stack.depth_mm
        for row in rows:
            i = int(row[1])
            if not (0 <= i < len(self.stack.layers) and borders[i] < row[0] < borders[i + 1]):
                raise record.wrong("depth", f"has {row[0]:g} mm in layer {row[1]:g}", "name the layer that holds it")
        if len(set(self.z)) < len(self.z):
            raise record.wrong("depth", "has a row twice", "write each depth once")

    def _read_radiance(self, record: SlabRecord) -> None:
        section = record.section("radiance")
        self.mu = np.array(section.numbers("mu", low=1e-3, high=1.0))
        self.radiance: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        for i, row in enumerate(section.rows("rows", 3)):
            nested = type(section)({"z_mm": row[0], "down": row[1], "up": row[2]}, f"{section.where}: rows[{i}]")
            z = nested.number("z_mm")
            if z not in self.z:
                raise section.wrong(f"rows[{i}]", f"is at {z:g} mm", "give a depth that `depth` has")
            down, up = (np.array(nested.numbers(key, len(self.mu), 0.0)) for key in ("down", "up"))
            self.radiance[self.z.index(z)] = (down, up)

    @property
    def cost(self) -> float:
        path = np.trapezoid(self.fluence, self.z) if len(self.z) > 1 else 1.0
        return (1.0 + float(path) * max(layer.mu_t for layer in self.stack.layers)) / self.wanted.fraction**2

    def __call__(self) -> RecordCheck:
        began = time.monotonic()
        walked = FieldWalk(self)
        results = [*self._totals(walked), *self._depths(walked), *self._exits(walked), *self._inside(walked)]
        scatterings = int(walked.counts[tally.scattered(len(self.parts))].sum())
        return RecordCheck(tuple(results), walked.histories, scatterings, time.monotonic() - began)

    def _totals(self, walked: FieldWalk) -> Iterator[Result]:
        for name, expected, column in zip(("R_total", "T_total"), self.totals, (tally.REFLECTED, tally.TRANSMITTED)):
            accuracy = self.accuracy["depth"] * expected
            yield fraction(self.id, name, expected, accuracy, int(walked.counts[column]), walked.histories)

    def _depths(self, walked: FieldWalk) -> Iterator[Result]:
        absorbed = walked.counts[tally.absorbed(len(self.parts))]
        for i, (z, about) in enumerate(zip(self.z, self.bins)):
            path = self.stack.layers[self.layer[i]].mu_t * about.width
            expected, accuracy = float(self.fluence[i]), self.accuracy["depth"]
            if path > 0.0:
                got, stderr = walked.collisions.mean[i], walked.collisions.stderr[i]
                yield events(
                    self.id, f"fluence_total[{i}]", expected * path, accuracy * expected * path, got, stderr,
                    walked.histories, unit=path,
                )  # fmt: skip
            below = sum(int(count) for count, part in zip(absorbed, self.parts) if part[1] >= z)
            count = below + int(walked.counts[tally.TRANSMITTED])
            expected = min(1.0, max(0.0, self.net_flux[i]))
            yield fraction(self.id, f"flux_net[{i}]", expected, accuracy, count, walked.histories)

    def _exits(self, walked: FieldWalk) -> Iterator[Result]:
        for k, about in self.exit_bins.items():
            solid_angle = math.pi * (about.high**2 - about.low**2)
            expected, accuracy = self.exit_radiance[k] * solid_angle, self.accuracy["exit"]
            row = fraction(self.id, "", expected, accuracy * expected, int(walked.exits[k]), walked.histories)
            values = (row.expected / solid_angle, row.got / solid_angle, row.stderr / solid_angle)
            yield Result(self.id, f"exit_radiance_top[{k}]", *values, row.z)

    def _inside(self, walked: FieldWalk) -> Iterator[Result]:
        for column, (i, side, k, about) in enumerate(self.radiance_bins):
            layer = self.stack.layers[self.layer[i]]
            unit = layer.mu_s * self.bins[i].width * 2.0 * math.pi * about.width
            expected = float(self.radiance[i][side][k]) * unit
            name = f"radiance_{('down', 'up')[side]}[{list(self.radiance).index(i)}][{k}]"
            got, stderr = walked.inside.mean[column], walked.inside.stderr[column]
            accuracy = self.accuracy["radiance"] * expected
            yield events(self.id, name, expected, accuracy, got, stderr, walked.histories, unit=unit)

    @property
    def exit_bins(self) -> dict[int, Bin]:
        """Bins of the outside cosine, by index; flux per cosine is what is even over a bin."""
        flux = self.exit_radiance * self.exit_mu
        bins = {k: cosine_bin(self.exit_mu, flux, k) for k in np.flatnonzero(flux > 0.0).tolist()}
        return {k: about for k, about in bins.items() if about is not None}

    @property
    def radiance_bins(self) -> list[tuple[int, int, int, Bin]]:
        """Bins of stored photons: depth, side (0 down, 1 up), cosine, interval of |cosine|.

        Left out: the direction of the beam itself, clear layers, cosines near the critical ones of total reflection,
        where radiance has an edge, and stacks in which unscattered diffuse light comes back from an inner border.
        """
        found = []
        if unscattered_return(self.stack.layers, self.stack.n_below) > CLEAN and self.stack.incidence == "diffuse":
            return found
        for i, both in self.radiance.items():
            edges = critical_cosines(self.stack, self.layer[i])
            for side, values in enumerate(both):
                for k in np.flatnonzero(values > 0.0).tolist():
                    about = cosine_bin(self.mu, values, k)
                    if about is None or self.mu[k] == 1.0 or self.stack.layers[self.layer[i]].mu_s == 0.0:
                        continue
                    if not any(about.low - COSINES < edge < about.high + COSINES for edge in edges):
                        found.append((i, side, k, about))
        return found


class FieldWalk:
    """The rounds walked for a check of fields, with what was counted in them."""

    def __init__(self, check: FieldCheck) -> None:
        self._check = check
        self._volume = build_volume(check.scene)
        self._light = light_from_scene(check.scene)
        self._layers = len(check.parts)
        self._about = [
            [n for n, (_, top, bottom) in enumerate(check.parts) if top >= about.low and bottom <= about.high]
            for about in check.bins
        ]
        per_round, rounds = self._plan()
        self.histories = per_round * rounds
        self.counts = np.zeros(tally.columns(self._layers), np.int64)
        self.exits = np.zeros(len(check.exit_mu), np.int64)
        self.collisions, self.inside = Means(), Means()
        self._exit_bins, self._radiance_bins = check.exit_bins, check.radiance_bins
        photon_pass = PhotonPass(self._volume, self._light, record_seed(check.seed, check.id))
        for index in range(rounds):
            self._enter(photon_pass, index, per_round)

    def _plan(self) -> tuple[int, int]:
        """Histories of a round, and rounds: as many histories as bring any fraction's error to half of what is wanted.

        Settled beforehand, by a pilot that counts how many photons a history stores.
        """
        seed = record_seed(self._check.seed, self._check.id, 1)
        pilot = PhotonPass(self._volume, self._light, seed).walk(0, np.array([PILOT_HISTORIES]), False)
        stored = max(1.0, pilot.tallies[0, tally.scattered(self._layers)].sum() / PILOT_HISTORIES)
        histories = min(1.0 / self._check.wanted.fraction**2, MOST_STORED / stored)
        rounds = max(ROUNDS, math.ceil(histories * stored / STORED_PER_ROUND))
        return math.ceil(histories / rounds), rounds

    def _enter(self, photon_pass: PhotonPass, index: int, histories: int) -> None:
        left: list[np.ndarray] = []
        walked = photon_pass.walk(index, np.array([histories]), True, left)
        check_counts(walked)
        counts = walked.tallies[0]
        self.counts += counts
        collided = counts[tally.absorbed(self._layers)] + counts[tally.scattered(self._layers)]
        self.collisions.add(np.array([collided[numbers].sum() for numbers in self._about]) / histories)
        cosine = -left[0][left[0][:, 5] > 0.0, 4]
        for k, about in self._exit_bins.items():
            self.exits[k] += np.count_nonzero((cosine > about.low) & (cosine <= about.high))
        self.inside.add(self._radiances(walked.position[:, 2], walked.direction) / histories)

    def _radiances(self, z: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Stored photons in each bin of radiance."""
        cosines = {}
        for i in {i for i, *_ in self._radiance_bins}:
            about = self._check.bins[i]
            cosines[i] = np.sort(cosine_of(direction[(z >= about.low) & (z < about.high)]))
        found = []
        for i, side, _, about in self._radiance_bins:
            edges = (about.low, about.high) if side == 0 else (-about.high, -about.low)
            found.append(np.diff(np.searchsorted(cosines[i], edges))[0])
        return np.array(found, float)


class Means(Batches):
    """Batches with their mean."""

    @property
    def mean(self) -> np.ndarray:
        return self._mean


def depth_bins(
    layers: Sequence[Layer], borders_mm: Sequence[float], z: Sequence[float], layer: Sequence[int], fluence: np.ndarray
) -> list[Bin]:
    """A thin bin about each depth (ascending), apart from the others and from the layers' borders."""
    bins = []
    for i, depth in enumerate(z):
        same = [k for k in range(len(z)) if layer[k] == layer[i]]
        half = half_width(np.array([z[k] for k in same]), fluence[same], same.index(i))
        others = [*borders_mm, *(other for other in z if other != depth)]
        half = min(half, 0.45 * min(abs(depth - other) for other in others))
        mu_t = layers[layer[i]].mu_t
        half = min(half, FREE_PATHS / mu_t) if mu_t > 0.0 else half
        bins.append(Bin(depth - half, depth + half))
    return bins


def cosine_bin(mu: np.ndarray, values: np.ndarray, k: int) -> Bin | None:
    """A bin about mu[k] over which the values hardly bend; at 1 one-sided; None where no neighbors tell."""
    if len(mu) < 3:
        return None
    if mu[k] == 1.0:
        slope = abs(values[k] - values[k - 1]) / (mu[k] - mu[k - 1])
        return Bin(1.0 - min(COSINES, 2.0 * BIN_BIAS * values[k] / max(slope, 1e-30)), 1.0)
    half = min(COSINES, half_width(mu, values, k), 0.5 * mu[k], 1.0 - mu[k])
    return Bin(mu[k] - half, mu[k] + half)


def half_width(x: np.ndarray, values: np.ndarray, k: int) -> float:
    """Half width of a bin about x[k] whose mean differs from values[k] by `BIN_BIAS`, by the bend of the neighbors."""
    bend = 0.0
    for first in range(max(0, k - 2), min(k, len(x) - 3) + 1):
        a, b, c = x[first : first + 3]
        fa, fb, fc = values[first : first + 3]
        bend = max(bend, abs(2.0 * ((fc - fb) / (c - b) - (fb - fa) / (b - a)) / (c - a)))
    return math.sqrt(6.0 * BIN_BIAS * abs(values[k]) / bend) if bend > 0.0 else math.inf


def critical_cosines(stack, layer: int) -> list[float]:
    """Cosines in a layer at which total reflection at any border begins."""
    n = stack.layers[layer].n
    others = {stack.n_above, stack.n_below, *(other.n for other in stack.layers)}
    return [math.sqrt(1.0 - (other / n) ** 2) for other in others if other < n]


def unscattered_return(layers: Sequence[Layer], n_below: float) -> float:
    """Bound of the part of steep unscattered light that inner borders and the bottom send back."""
    depth, returned = 0.0, 0.0
    for upper, lower_n in zip(layers, [*(layer.n for layer in layers[1:]), n_below]):
        depth += upper.mu_t * upper.thickness_mm
        if lower_n != upper.n:
            # Diffuse light in the medium is at most about 45 degrees steep: four times the reflectance at normal.
            returned += math.exp(-depth) * min(1.0, 4.0 * ((upper.n - lower_n) / (upper.n + lower_n)) ** 2)
    return returned


def cosine_of(direction: np.ndarray) -> np.ndarray:
    """Vertical cosines of octahedral codes (n, 2); the middle of each cell, see `transport.turn.pack_direction`."""
    p = np.abs((direction.astype(np.float64) + (0.5 - 32768.0)) / 32767.0)
    z = 1.0 - p[:, 0] - p[:, 1]
    x = np.where(z < 0.0, 1.0 - p[:, 1], p[:, 0])
    y = np.where(z < 0.0, 1.0 - p[:, 0], p[:, 1])
    return z / np.sqrt(x * x + y * y + z * z)
