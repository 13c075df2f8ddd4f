"""Seconds that `plan` predicts against those that the stages take: `python -m benchmarks.plan`."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

CONFIGS = Path(__file__).parents[1] / "configs"
SCENES = {
    "smoke_beam": [],
    "smoke_point": [],
    "slab_blue": ["--photons", "3e6"],
    "fig12_epidermal": ["--photons", "3e6", "--workers", "1"],
}


def told_by(command: str, scene: str, options: list[str]) -> dict:
    """The JSON object of a command."""
    call = [sys.executable, "-m", "skinrender.cli", command, str(CONFIGS / f"{scene}.yaml"), *options, "--json"]
    return json.loads(subprocess.run(call, capture_output=True, text=True, check=True).stdout)


def compare(scene: str) -> list[str]:
    """A row a stage: predicted and measured seconds; the kernels are compiled by a run before."""
    options = SCENES[scene]
    with tempfile.TemporaryDirectory() as folder:
        for name in ("warm", "timed"):
            predicted = told_by("plan", scene, options)["seconds"]
            measured = told_by("render", scene, [*options, "-o", f"{folder}/{name}"])["seconds"]
    # the run's own clock counts its pilot and the building as loading
    measured["build + trace"] = measured["load"] + measured["trace"]
    predicted["build + trace"] = predicted["build"] + predicted["trace"]
    rows = ("build + trace", "estimate", "write", "total")
    return [
        f"{scene:18} {stage:14} {predicted[stage]:10.2f} {measured[stage]:10.2f} {predicted[stage] / measured[stage]:6.2f}"
        for stage in rows
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=list(SCENES), help=f"of {', '.join(SCENES)}")
    options = parser.parse_args()
    print(f"{'scene':18} {'stage':14} {'predicted':>10} {'measured':>10} {'ratio':>6}")
    for scene in options.scenes:
        print("\n".join(compare(scene)), flush=True)


if __name__ == "__main__":
    main()
