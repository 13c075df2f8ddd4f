"""One round's work, as it is sent to a worker."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.engine.disk import disk_errors
from skinrender.engine.ledger import check_counts
from skinrender.engine.recipe import Recipe
from skinrender.errors import InputError
from skinrender.photonmap.store import RoundCounts, read_round, round_path, write_round

_built: tuple[str, Any] | None = None


@dataclass(frozen=True, eq=False)
class WalkRound:
    """Walk a round unless its finished file is there; only counts come back.

    Parameters
    ----------
    recipe, seed : of the photon pass.
    histories : (B,) of each band in a round.
    key : fingerprint of all that determines the photons.
    folder : where round files go; None counts without storing.
    """

    recipe: Recipe
    seed: int
    histories: np.ndarray
    key: str
    folder: Path | None

    def __call__(self, index: int) -> RoundCounts:
        if self.folder is None:
            walked = self._walk(index, store=False)
            return RoundCounts(index, walked.emitted, walked.stored_per_band, walked.tallies)
        path = round_path(self.folder, index)
        if path.exists():
            try:
                return read_round(path, self.key, verify=True)
            except InputError:
                path.unlink()
        walked = self._walk(index, store=True)
        with disk_errors(self.folder):
            return write_round(self.folder, self.key, walked)

    def _walk(self, index: int, *, store: bool) -> Any:
        walked = photon_pass(self.recipe, self.seed, self.key).walk(index, self.histories, store)
        check_counts(walked)
        return walked


def photon_pass(recipe: Recipe, seed: int, key: str) -> Any:
    """The pass of a recipe; the one used last is kept, so a process prepares it once."""
    global _built
    if _built is None or _built[0] != key:
        _built = (key, recipe.build(seed))
    return _built[1]
