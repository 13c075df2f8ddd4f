"""What is settled before the first round: the plan of the rounds, and what determines their bytes."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.engine.clock import StageClock
from skinrender.engine.crew import Crew
from skinrender.engine.identity import machine_identity, program_identity
from skinrender.engine.interrupt import listen
from skinrender.engine.ledger import Ledger
from skinrender.engine.recipe import Recipe
from skinrender.engine.rounds import PILOT_SEED, RoundPlan, plan_rounds, run_pilot, uniform_share, visible_share
from skinrender.engine.stop import Stop, StoredCount, described
from skinrender.engine.summary import TraceSummary, summarize
from skinrender.engine.work import WalkRound, photon_pass
from skinrender.photonmap.photon_map import FORMAT_VERSION
from skinrender.photonmap.store import MapHeader, map_bytes, round_bytes


@dataclass(frozen=True, eq=False)
class Run:
    """A run before its first round.

    Parameters
    ----------
    recipe, seed : of the photon pass.
    histories : (B,) in each round.
    header : what the photon map holds once.
    """

    recipe: Recipe
    seed: int
    histories: np.ndarray
    header: MapHeader

    def new_ledger(self) -> Ledger:
        """An empty ledger for this run's rounds."""
        return Ledger(self.header.power_aimed_per_band)

    def work(self, folder: Path | None) -> WalkRound:
        """What a worker does for a round; without a folder it only counts."""
        return WalkRound(self.recipe, self.seed, self.histories, self.header.key, folder)

    def rounds_bytes(self, plan: RoundPlan) -> int:
        """Size of the files of all rounds that are expected."""
        return plan.rounds_expected * round_bytes(self.header, round(plan.stored_per_round))

    def map_bytes(self, plan: RoundPlan) -> int:
        """Size of the finished map; for a moment it and the rounds' files exist together."""
        header = replace(self.header, provenance=complete_provenance(self.header, StoredCount(plan.stored_wanted)))
        return map_bytes(header, plan.rounds_expected, round(plan.stored_expected))

    def summary(self, ledger: Ledger, seconds: Mapping[str, float] | None = None) -> TraceSummary:
        """What the ledger's rounds say."""
        return summarize(ledger, self.header.wavelength_nm, self.header.layer_name, seconds)


def plan_run(recipe: Recipe, seed: int, stored: float, wavelengths: str = "uniform") -> tuple[Run, RoundPlan]:
    """Walk the pilot and plan the rounds.

    Parameters
    ----------
    recipe, seed : of the photon pass.
    stored : photons wanted.
    wavelengths : "uniform" or "visible", how histories are shared among the bands, see `rounds`.
    """
    pilot_pass = photon_pass(recipe, PILOT_SEED)
    power = pilot_pass.power_per_band_aimed
    wavelength_nm = recipe.describe(pilot_pass)["wavelength_nm"]
    share = uniform_share(power) if wavelengths == "uniform" else visible_share(power, wavelength_nm)
    plan = plan_rounds(run_pilot(pilot_pass, share), share, int(stored))
    return Run(recipe, seed, plan.histories, _header(recipe, seed, plan.histories, plan.stored_wanted, pilot_pass)), plan


def count_light(
    recipe: Recipe, seed: int, histories: np.ndarray, stop: Stop, *, crew: Crew | None = None
) -> TraceSummary:
    """Walk rounds without storing photons, for reflectances alone; writes nothing.

    Parameters
    ----------
    recipe, seed : of the photon pass.
    histories : (B,) in each round.
    stop : when the fractions are known well enough.
    crew : who does the work; by default this process.
    """
    histories = np.asarray(histories, np.int64)
    run = Run(recipe, seed, histories, _header(recipe, seed, histories, 0, photon_pass(recipe, seed)))
    ledger, clock = run.new_ledger(), StageClock()
    with listen() as interrupt, clock.stage("trace"):
        (crew or Crew(workers=1)).walk(run.work(None), itertools.count(), ledger, stop, interrupt)
    return run.summary(ledger, clock.seconds)


def complete_provenance(header: MapHeader, stop: Stop) -> Mapping[str, Any]:
    """Provenance of the map: that of its rounds, and where they end."""
    return _as_json({**header.provenance, "stop": described(stop)})


def _header(recipe: Recipe, seed: int, histories: np.ndarray, stored_wanted: int, photon_pass: Any) -> MapHeader:
    provenance = {
        "format_version": FORMAT_VERSION,
        **recipe.provenance,
        "seed": seed,
        "histories_per_round": histories.tolist(),
        "program": program_identity(),
        "machine": machine_identity(),
    }
    return MapHeader(
        **recipe.describe(photon_pass), provenance=_as_json(provenance), stored_wanted=stored_wanted
    )


def _as_json(value: Mapping[str, Any]) -> Mapping[str, Any]:
    """As it will be read back."""
    return json.loads(json.dumps(value))
