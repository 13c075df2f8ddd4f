"""One round's work, as it is sent to a worker."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.engine.disk import disk_errors
from skinrender.engine.ledger import check_counts
from skinrender.engine.recipe import Recipe, VolumeFile, VolumeRecipe
from skinrender.errors import InputError
from skinrender.photonmap.store import RoundCounts, read_round, round_path, write_round

_built: tuple[Mapping[str, Any], Any] | None = None
_one_builds = threading.Lock()


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
        finished = self.finished(index)
        return self.keep(self.walk(index)) if finished is None else finished

    def finished(self, index: int) -> RoundCounts | None:
        """Counts of a round whose file is there and sound."""
        if self.folder is None:
            return None
        path = round_path(self.folder, index)
        if not path.exists():
            return None
        try:
            return read_round(path, self.key, verify=True)
        except InputError:
            path.unlink()
            return None

    @property
    def volume_file(self) -> VolumeFile | None:
        """The file that a worker elsewhere needs, if any."""
        return self.recipe.volume_file if isinstance(self.recipe, VolumeRecipe) else None

    def errand(self, index: int) -> Callable[[Path | None], Any]:
        """What a worker elsewhere is sent: walks the round in a volume that lies there."""
        return partial(_walk_in, self, index)

    def walk(self, index: int) -> Any:
        """A walked round (a `photon_pass.Round`), with its photons if they are to be stored."""
        walked = photon_pass(self.recipe, self.seed).walk(index, self.histories, self.folder is not None)
        check_counts(walked)
        return walked

    def keep(self, walked: Any) -> RoundCounts:
        """Write a walked round to its file; its counts."""
        if self.folder is None:
            return RoundCounts(walked.index, walked.emitted, walked.stored_per_band, walked.tallies)
        with disk_errors(self.folder):
            return write_round(self.folder, self.key, walked)


def _walk_in(work: WalkRound, index: int, volume_path: Path | None) -> Any:
    if volume_path is not None:
        work = replace(work, recipe=replace(work.recipe, volume_path=volume_path))
    return work.walk(index)


def photon_pass(recipe: Recipe, seed: int) -> Any:
    """The pass of a recipe; the one used last is kept, so a process prepares it once, whatever its threads and seeds."""
    global _built
    with _one_builds:
        if _built is None or _built[0] != recipe.provenance:
            _built = (recipe.provenance, recipe.build(seed))
        elif _built[1].seed != seed:
            _built = (recipe.provenance, _built[1].seeded(seed))
        return _built[1]
