"""What each feature costs: pairs of scenes with and without it, run in turn: `python -m benchmarks.leave_out`.

Every side walks the same number of histories and makes a picture of the photons that these store.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from skinrender.engine.estimate import estimate
from skinrender.engine.rounds import uniform_share
from skinrender.engine.timed import round_as_map, timed
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.scene import load_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.memory import peak_bytes

CONFIGS = Path(__file__).parents[1] / "configs"
FLAT = ("relief={kind: flat}",)
LEVEL = (*FLAT, "skin.border_wave.peak_to_valley_um=0")
THREE = ("bands_nm=[450,550,650]",)
SMALL = ("camera.pixels=[100,100]",)


@dataclass(frozen=True)
class Side:
    """A scene, and whether its photons are stored and seen or only counted."""

    config: str
    overrides: tuple[str, ...] = ()
    storing: bool = True

    def scene(self):
        """The scene, in a picture small enough to be made often."""
        return load_scene(CONFIGS / f"{self.config}.yaml", (*SMALL, *self.overrides))


PAIRS = {
    "relief": (Side("fig10_forearm", THREE), Side("fig10_forearm", THREE + FLAT)),
    "border wave": (Side("fig10_forearm", THREE + FLAT), Side("fig10_forearm", THREE + LEVEL)),
    "lesion": (Side("fig12_epidermal", THREE + FLAT), Side("fig10_forearm", THREE + FLAT)),
    "81 bands, not 1": (Side("fig10_forearm", LEVEL), Side("fig10_forearm", (*LEVEL, "bands_nm=[550]"))),
    "surface Fresnel": (Side("slab_red"), Side("slab_red_matched")),
    "inner borders": (
        Side("fig10_forearm", (*THREE, *LEVEL, "inner_borders=fresnel")),
        Side("fig10_forearm", (*THREE, *LEVEL, "inner_borders=matched")),
    ),
    "storing, not counting": (Side("fig10_forearm", THREE), Side("fig10_forearm", THREE, storing=False)),
    "roulette": (Side("fig10_forearm", THREE), Side("fig10_forearm", (*THREE, "photons.roulette=false"))),
    "surface reflection": (
        Side("fig10_forearm", THREE),
        Side("fig10_forearm", (*THREE, "camera.cross_polarized=true")),
    ),
}


@dataclass
class Cost:
    """Of one side: seconds of each run, photons stored, and the most memory that a process for it alone held."""

    build: list[float] = field(default_factory=list)
    walk: list[float] = field(default_factory=list)
    estimate: list[float] = field(default_factory=list)
    stored: int = 0
    peak: int = 0


def run_once(side: Side, histories: int, cost: Cost) -> None:
    """Build, walk and estimate one side; enters what it took."""
    scene = side.scene()
    seconds, volume = timed(lambda: build_volume(scene))
    cost.build.append(seconds)
    photon_pass = PhotonPass(volume, light_from_scene(scene), 1, roulette=scene.photons.roulette)
    share = uniform_share(photon_pass.power_per_band_aimed)
    photon_pass.walk(0, np.ceil(share).astype(np.int64), side.storing)  # prepares the bands
    each = np.ceil(share * (histories / share.sum())).astype(np.int64)
    seconds, walked = timed(lambda: photon_pass.walk(0, each, side.storing))
    cost.walk.append(seconds)
    cost.stored = len(walked.position)
    if side.storing:
        photon_map = round_as_map(photon_pass, walked, 1)
        cost.estimate.append(timed(lambda: estimate(scene, volume, photon_map, progress=False))[0])


def run_pair(name: str, runs: int, histories: int) -> tuple[Cost, Cost]:
    """Both sides of a pair in turn; the first run of each, which loads the kernels, does not count."""
    costs = Cost(), Cost()
    for side in PAIRS[name]:
        run_once(side, histories, Cost())
    for _ in range(runs):
        for side, cost in zip(PAIRS[name], costs):
            run_once(side, histories, cost)
    for index, cost in enumerate(costs):
        cost.peak = _peak_alone(name, index, histories)
    return costs


def _peak_alone(name: str, side: int, histories: int) -> int:
    command = [sys.executable, "-m", "benchmarks.leave_out", name, "--side", str(side), "--histories", str(histories)]
    return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def table(costs: dict[str, tuple[Cost, Cost]]) -> str:
    """Medians: two rows a pair, and their ratio."""
    lines = [f"{'feature':24} {'':8} {'build s':>8} {'walk s':>8} {'stored':>10} {'estimate s':>10} {'peak MB':>8}"]
    for name, pair in costs.items():
        rows = [
            [_median(c.build), _median(c.walk), float(c.stored), _median(c.estimate), c.peak / 1e6] for c in pair
        ]
        for label, row in zip(("with", "without"), rows):
            build, walk, stored, picture, peak = row
            lines.append(f"{name:24} {label:8} {build:8.3f} {walk:8.3f} {stored:10.0f} {picture:10.3f} {peak:8.0f}")
        ratios = [a / b if b else float("nan") for a, b in zip(*rows)]
        build, walk, stored, picture, peak = ratios
        lines.append(f"{'':24} {'ratio':8} {build:8.2f} {walk:8.2f} {stored:10.2f} {picture:10.2f} {peak:8.2f}")
    return "\n".join(lines)


def _median(seconds: list[float]) -> float:
    return statistics.median(seconds) if seconds else 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("features", nargs="*", default=list(PAIRS), help=f"of {', '.join(PAIRS)}")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--histories", type=int, default=20_000, help="of all bands together")
    parser.add_argument("--side", type=int, choices=(0, 1), help="run this side once and print the bytes it held")
    parser.add_argument("--json", action="store_true", help="print every run")
    options = parser.parse_args()
    if options.side is not None:
        run_once(PAIRS[options.features[0]][options.side], options.histories, Cost())
        print(peak_bytes())
        return
    costs = {name: run_pair(name, options.runs, options.histories) for name in options.features}
    print(json.dumps({name: [asdict(c) for c in pair] for name, pair in costs.items()}) if options.json else table(costs))


if __name__ == "__main__":
    main()
