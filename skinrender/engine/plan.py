"""What a scene needs before any of it is made: features, photons, bytes, seconds.

The volume is built in memory and the run's own pilot is walked in it. Bytes come from the functions that the run itself
checks its disk with; seconds from short timed runs (`timed`), stretched to the size of the run.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.engine.crew import Crew
from skinrender.engine.estimate import estimate_bytes
from skinrender.engine.features import Feature, Planned, features_of
from skinrender.engine.recipe import HeldRecipe
from skinrender.engine.rounds import PILOT_HISTORIES, PILOT_ROUNDS, RoundPlan
from skinrender.engine.run import Run, plan_run
from skinrender.engine.timed import Linear, loading_seconds, time_estimate, time_walk, time_writing, timed
from skinrender.engine.view import why_no_picture
from skinrender.film.exr import exr_bytes, write_exr
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_pass import PhotonPass, Round, pass_bytes, round_memory_bytes
from skinrender.scene import Scene
from skinrender.skin.builder import build_volume
from skinrender.skin.heights import heights_bytes
from skinrender.skin.section import USUAL_BYTES, draw_section
from skinrender.skin.volume import SkinVolume, volume_bytes
from skinrender.transport import tally

PROGRAM_BYTES = {"build": 85_000_000, "trace": 180_000_000, "estimate": 190_000_000}
"""Interpreter, libraries and kernels, whatever the scene; measured on Linux, x86-64."""
ASSUMPTIONS = (
    "seconds: the machine stays as busy as it was during this plan, and its kernels are compiled",
    "seconds: importing the libraries, one to two seconds a command, comes on top",
    "seconds: the disk of the results is as fast as that of the temporary folder",
    "seconds: workers and threads share the work evenly, each on a core of its own",
    "memory: the photon map is mapped, not held; pages of it that the system keeps come on top",
)


@dataclass(frozen=True, eq=False)
class Plan:
    """What a run will probably take.

    Parameters
    ----------
    features : used or left out.
    voxels : (nx, ny, nz).
    photons_emitted, photons_stored, rounds : of the photon pass.
    workers : processes that walk.
    bytes : of ``volume`` and ``photons``, ``disk_peak`` of the folder, ``memory`` of the stage that takes most.
    memory : resident bytes by stage.
    seconds : by stage, and their ``total``.
    """

    features: tuple[Feature, ...]
    voxels: tuple[int, int, int]
    photons_emitted: int
    photons_stored: int
    rounds: int
    workers: int
    bytes: Mapping[str, int]
    memory: Mapping[str, int]
    seconds: Mapping[str, float]

    def as_json(self) -> dict[str, Any]:
        """The object that ``skinrender plan --json`` prints."""
        return {
            "features": [asdict(feature) for feature in self.features],
            "voxels": list(self.voxels),
            "photons_emitted": self.photons_emitted,
            "photons_stored": self.photons_stored,
            "rounds": self.rounds,
            "workers": self.workers,
            "bytes": dict(self.bytes),
            "memory_by_stage": dict(self.memory),
            "seconds": dict(self.seconds),
            "assumptions": list(ASSUMPTIONS),
        }


def make_plan(scene: Scene, *, workers: int | None = None) -> Plan:
    """Plan a scene's build, trace and estimate; takes seconds and leaves no file.

    Parameters
    ----------
    scene : all of it is read.
    workers : processes of the photon pass and threads of the estimate; None lets the size of the run decide.

    Raises
    ------
    InputError : what the run itself would refuse, a volume larger than the memory among it.
    """
    build_seconds, volume = timed(lambda: build_volume(scene))
    tried = _try_pass(HeldRecipe(volume, light_from_scene(scene), scene.photons.roulette), scene.photons)
    run, rounds, walked = tried.run, tried.rounds, tried.walked
    processes = Crew(workers).workers_for(rounds.stored_wanted)
    sizes = {"volume": volume_bytes(volume), "photons": run.map_bytes(rounds)}
    memory = {"build": _build_memory(volume, sizes), "trace": _trace_memory(volume, sizes, processes, rounds)}
    writing = time_writing()
    seconds = {
        "build": build_seconds + writing.at(sizes["volume"]),
        "trace": tried.seconds(processes) + rounds.rounds_expected * writing.start
        + writing.at(run.rounds_bytes(rounds) + sizes["photons"]),
    }  # fmt: skip
    picture = 0
    if why_no_picture(volume) is None:
        rate, piece = time_estimate(scene, volume, tried.photon_pass, walked)
        seconds["estimate"] = rate.at(math.prod(scene.camera.pixels), rounds.stored_expected)
        picture = _picture_bytes(scene, volume)
        needed = estimate_bytes(scene, volume, scene.estimate.method, rounds.rounds_expected, workers)
        memory["estimate"] = PROGRAM_BYTES["estimate"] + sizes["volume"] + needed
        seconds["write"] = _write_seconds(volume, piece, picture)
    sizes["disk_peak"] = _disk_peak(run, rounds, sizes, picture)
    sizes["memory"] = max(memory.values())
    planned = Planned(scene, volume, tried.photon_pass, tried.stored_share, rounds.stored_wanted, workers)
    return Plan(
        features=tuple(features_of(planned)),
        voxels=volume.shape,
        photons_emitted=rounds.emitted_expected,
        photons_stored=round(rounds.stored_expected),
        rounds=rounds.rounds_expected,
        workers=processes,
        bytes=sizes,
        memory=memory,
        seconds=seconds | {"total": sum(seconds.values())},
    )


@dataclass(frozen=True, eq=False)
class _TriedPass:
    """A photon pass that was tried for a moment.

    Parameters
    ----------
    run, rounds : as the run itself plans them.
    photon_pass, walked : prepared, and a small round of it.
    first_seconds : of the pilot, whose first walk loads the kernels or compiles them.
    prepare_seconds, history_seconds : of a pass made ready again, and of each history.
    """

    run: Run
    rounds: RoundPlan
    photon_pass: PhotonPass
    walked: Round
    first_seconds: float
    prepare_seconds: float
    history_seconds: float

    @property
    def stored_share(self) -> float:
        """Photons stored per scattering event."""
        layers = len(self.photon_pass.layer_names)
        return float(self.walked.stored_per_band.sum() / max(1, self.walked.tallies[:, tally.scattered(layers)].sum()))

    def seconds(self, processes: int) -> float:
        """Of the whole pass but for its files: pilot, workers made ready, walk."""
        pilot = self.prepare_seconds + self.history_seconds * PILOT_ROUNDS * PILOT_HISTORIES
        ready = 0.0 if processes == 1 else self.prepare_seconds
        walk = self.history_seconds * self.rounds.emitted_expected / processes
        return loading_seconds(self.first_seconds, pilot) + pilot + ready + walk


def _try_pass(recipe: HeldRecipe, photons: Any) -> _TriedPass:
    """Plan the rounds and walk a little of one; photons: the scene's ``photons``."""
    first_seconds, (run, rounds) = timed(lambda: plan_run(recipe, photons.seed, photons.stored, photons.wavelengths))

    def prepare() -> PhotonPass:
        photon_pass = recipe.build(photons.seed)
        photon_pass.walk(0, np.minimum(rounds.histories, 1), True)
        return photon_pass

    prepare_seconds, photon_pass = timed(prepare)
    history_seconds, walked = time_walk(photon_pass, rounds.histories)
    return _TriedPass(run, rounds, photon_pass, walked, first_seconds, prepare_seconds, history_seconds)


def _build_memory(volume: SkinVolume, sizes: Mapping[str, int]) -> int:
    samples = (0, 0) if volume.is_flat else (volume.surface_mm if volume.has_relief else volume.border_mm[0]).shape
    return PROGRAM_BYTES["build"] + sizes["volume"] + heights_bytes(samples, len(volume.layer_name) - 1)


def _trace_memory(volume: SkinVolume, sizes: Mapping[str, int], workers: int, rounds: RoundPlan) -> int:
    """Of all processes: each has the volume mapped and a pass, as the one that walks the pilot is no worker's."""
    processes = workers if workers == 1 else workers + 1
    each = PROGRAM_BYTES["trace"] + sizes["volume"] + pass_bytes(volume)
    return processes * each + workers * round(round_memory_bytes(rounds.stored_per_round))


def _picture_bytes(scene: Any, volume: SkinVolume) -> int:
    """EXR, and at most three bytes a pixel of PNG."""
    pixels = math.prod(scene.camera.pixels)
    return exr_bytes(pixels, len(volume.wavelength_nm)) + 3 * pixels


def _disk_peak(run: Run, rounds: RoundPlan, sizes: Mapping[str, int], picture: int) -> int:
    """Most that the folder ever holds: the rounds stay until the map that is made of them is complete."""
    later = max(run.rounds_bytes(rounds), picture)
    return sizes["volume"] + USUAL_BYTES + sizes["photons"] + later


def _write_seconds(volume: SkinVolume, piece: Any, picture: int) -> float:
    """Section and picture; the picture's time grows with its size."""
    with tempfile.TemporaryDirectory(prefix="skinrender-plan-") as name:
        folder = Path(name)
        section, _ = timed(lambda: draw_section(volume, folder / "section.png"))
        first, _ = timed(lambda: write_exr(folder / "piece.exr", piece))
        again, _ = timed(lambda: write_exr(folder / "piece.exr", piece))
    pixels, bands = math.prod(piece.radiance.shape[:2]), piece.radiance.shape[2]
    return section + Linear(first - again, again / exr_bytes(pixels, bands)).at(picture)
