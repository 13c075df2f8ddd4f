"""A photon pass of plain numpy: each history a pure function of (seed, band, index), two layers."""

from __future__ import annotations

import copy
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from skinrender.transport import tally

LAYERS = 2
POWER = np.array([1.0, 3.0, 0.5])


@dataclass(frozen=True)
class FakeRound:
    index: int
    emitted: np.ndarray
    tallies: np.ndarray
    position: np.ndarray
    direction: np.ndarray
    stored_per_band: np.ndarray


def mixed(values: np.ndarray) -> np.ndarray:
    """SplitMix64's finalizer: 64 random bits of a counter."""
    values = (values ^ (values >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    values = (values ^ (values >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return values ^ (values >> np.uint64(31))


class FakePass:
    """Reflects a fifth, absorbs half in the first layer, the rest in the second; stores 0 to 7 photons a history."""

    def __init__(
        self, seed: int, power: np.ndarray = POWER, stored: bool = True, lose: bool = False,
        happen: Callable[[], None] = lambda: None,
    ):  # fmt: skip
        self.seed, self.power_per_band_aimed, self.stored, self.lose = seed, power, stored, lose
        self.happen = happen
        self.layer_names = ("upper", "lower")
        self.bands = len(power)

    def seeded(self, seed: int) -> FakePass:
        other = copy.copy(self)
        other.seed = seed
        return other

    def walk(self, round_index: int, histories: np.ndarray, store: bool) -> FakeRound:
        if self.seed == SEED:
            self.happen()
        tallies = np.zeros((self.bands, tally.columns(LAYERS)), np.int64)
        stored = np.zeros(self.bands, np.int64)
        pieces = []
        for band, count in enumerate(histories):
            index = np.arange(count, dtype=np.uint64) + np.uint64(round_index) * np.uint64(count)
            bits = mixed(index + np.uint64(((self.seed * 1000 + band) << 32) % 2**64))
            fate = bits % np.uint64(10)
            tallies[band, tally.EMITTED] = count
            tallies[band, tally.REFLECTED] = (fate < 2).sum()
            tallies[band, tally.SPECULAR] = (fate < 1).sum()
            tallies[band, tally.absorbed(LAYERS)] = (((fate >= 2) & (fate < 7)).sum(), (fate >= 7).sum())
            events = (bits >> np.uint64(8)) % np.uint64(8)
            tallies[band, tally.scattered(LAYERS)] = (events.sum(), 0)
            if self.lose:
                tallies[band, [tally.REFLECTED, tally.LOST]] += (-1, 1)
            if store and self.stored:
                pieces.append(np.repeat(bits, events.astype(np.int64)))
                stored[band] = len(pieces[-1])
        bits = np.concatenate(pieces) if pieces else np.zeros(0, np.uint64)
        position = np.stack([(bits >> np.uint64(s)) % np.uint64(1000) for s in (8, 20, 32)], axis=1) / 1000
        direction = np.stack([bits >> np.uint64(16), bits >> np.uint64(40)], axis=1).astype(np.uint16)
        emitted = np.array(histories, np.int64)
        return FakeRound(round_index, emitted, tallies, position.astype(np.float32), direction, stored)


@dataclass(frozen=True, eq=False)
class FakeRecipe:
    """Makes `FakePass`; `accident` is (what, folder) that befalls the first walk that finds no note of it there."""

    name: str = "fake"
    stored: bool = True
    lose: bool = False
    accident: tuple[str, Path] | None = None
    slow_s: float = 0.0
    power: tuple[float, ...] = field(default_factory=lambda: tuple(POWER))

    @property
    def provenance(self) -> dict:
        return {"fake": self.name}

    def build(self, seed: int) -> FakePass:
        return FakePass(seed, np.array(self.power), self.stored, self.lose, self._happen)

    def describe(self, photon_pass: FakePass) -> dict:
        return {
            "wavelength_nm": 450.0 + 50.0 * np.arange(len(self.power)),
            "power_aimed_per_band": photon_pass.power_per_band_aimed,
            "bounds_mm": np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]),
            "layer_name": photon_pass.layer_names,
        }

    def _happen(self) -> None:
        time.sleep(self.slow_s)
        if self.accident is None:
            return
        what, folder = self.accident
        note = folder / f"{what}.note"
        if what == "always dies" or not note.exists():
            note.touch()
            if what == "out of memory":
                np.empty(1 << 60, np.uint8)
            elif what == "interrupt":
                os.kill(os.getpid(), signal.SIGINT)
            else:
                os.kill(os.getpid(), signal.SIGKILL)


SEED = 5


def fake_scene(stored: float = 4000, seed: int = SEED) -> SimpleNamespace:
    return SimpleNamespace(photons=SimpleNamespace(stored=stored, seed=seed, wavelengths="uniform"))
