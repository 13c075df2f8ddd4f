"""Renders in a loop, in one process: memory must stay flat, and nothing may be left behind.

``python -m tests.system.soak --seconds 3600`` prints a row each `ROW_SECONDS`, and ends with 1 if anything grows.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import theilslopes

import skinrender
from tests import leaks

CONFIGS = Path(__file__).parents[2] / "configs"
SMALL = ("camera.pixels=[24,24]", "photons.stored=2e5")
KINDS = (
    ("smoke_beam", "beam", 1),
    ("smoke_point", "point", 2),
    ("slab_red", "reference", 1),
    ("fig14_deep", "beam", 2),
)
"""Scene, method, workers; taken in turn, each with another seed every time."""
WARM_RENDERS = 2 * len(KINDS)
"""Kernels are loaded and caches filled by then."""
MOST_GROWTH_BYTES = 16 << 20
ROW_SECONDS = 60.0


@dataclass(frozen=True)
class Sample:
    """What the process holds after so many renders.

    Parameters
    ----------
    anonymous : bytes of memory that no file backs.
    mapped : bytes of files in memory.
    shared, temporary, children : entries of /dev/shm, files in the temporary folder and in the runs' that should have
        gone, child processes.
    """

    renders: int
    seconds: float
    anonymous: int
    mapped: int
    descriptors: int
    threads: int
    shared: int
    temporary: int
    children: int


COUNTED = ("descriptors", "threads", "shared", "temporary", "children")
"""May not be more at the end than when warm."""


def soak(folder: Path, seconds: float, fewest: int) -> Iterator[Sample]:
    """Render for so long, and so often at least; a sample after each render."""
    leaks.name_semaphores()
    temporary, before = folder / "temporary", tempfile.tempdir
    temporary.mkdir()
    tempfile.tempdir = str(temporary)
    began = time.monotonic()
    try:
        for count, (name, method, workers) in enumerate(itertools.cycle(KINDS), start=1):
            render_once(folder / name, name, method, workers, seed=count)
            yield sample(folder, count, time.monotonic() - began)
            if count >= fewest and time.monotonic() - began > seconds:
                return
    finally:
        tempfile.tempdir = before


def render_once(out: Path, name: str, method: str, workers: int, seed: int) -> None:
    """Scene to picture files through the Python API, over whatever the last time left in the folder."""
    scene = skinrender.load_scene(CONFIGS / f"{name}.yaml", [*SMALL, f"photons.seed={seed}"])
    out.mkdir(exist_ok=True)
    skinrender.save_volume(skinrender.build(scene), out / "volume.npz")
    volume = skinrender.load_volume(out / "volume.npz")
    skinrender.trace(scene, out / "volume.npz", out, workers=workers, progress=False)
    photon_map = skinrender.open_map(out / "photons.npz")
    image, _ = skinrender.estimate(scene, volume, photon_map, method=method, progress=False)
    skinrender.write_exr(out / "picture.exr", image)
    skinrender.write_png(out / "picture.png", image.display_rgb())


def sample(folder: Path, renders: int, seconds: float) -> Sample:
    """What this process holds now."""
    gc.collect()
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines() if ":" in line)
    temporary = (
        list((folder / "temporary").iterdir()) + list(folder.glob("*/rounds")) + list(leaks.partial_files(folder))
    )
    return Sample(
        renders, seconds, 1024 * int(status["RssAnon"].split()[0]), 1024 * int(status["RssFile"].split()[0]),
        len(os.listdir("/proc/self/fd")), threading.active_count(), len(leaks.shared_memory()), len(temporary),
        len(leaks.children()),
    )  # fmt: skip


def growth(samples: list[Sample]) -> tuple[float, float]:
    """Bytes by which memory grew over the warm samples: the middle slope between pairs, and its lower 95 % bound."""
    warm = samples[WARM_RENDERS:]
    renders = np.array([one.renders for one in warm])
    slope, _, low, _ = theilslopes([one.anonymous for one in warm], renders)
    return slope * np.ptp(renders), low * np.ptp(renders)


def complaints(samples: list[Sample]) -> list[str]:
    """What grew or was left behind; empty when all is well."""
    warm, last = samples[WARM_RENDERS - len(KINDS) : WARM_RENDERS], samples[-len(KINDS) :]
    found = []
    for name in COUNTED:
        then, now = (max(getattr(one, name) for one in some) for some in (warm, last))
        if now > then:
            found.append(f"{name}: {then} when warm, {now} at the end")
    likely, surely = growth(samples)
    if surely > 0 and likely > MOST_GROWTH_BYTES:
        found.append(f"memory grew by {likely / 1e6:.1f} MB over {samples[-1].renders - WARM_RENDERS} renders")
    left = [
        f"{name}: {getattr(samples[-1], name)} left"
        for name in ("shared", "temporary", "children")
        if getattr(samples[-1], name)
    ]
    return found + left


def row(one: Sample) -> str:
    """A row of the table."""
    return (
        f"{one.seconds:8.0f} {one.renders:8d} {one.anonymous / 1e6:10.1f} {one.mapped / 1e6:10.1f} "
        + " ".join(f"{getattr(one, name):>11d}" for name in COUNTED)
    )  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    options = parser.parse_args()
    print(
        f"{'seconds':>8} {'renders':>8} {'memory MB':>10} {'files MB':>10} "
        + " ".join(f"{name:>11}" for name in COUNTED)
    )
    samples, told = [], -ROW_SECONDS
    with tempfile.TemporaryDirectory(prefix="skinrender-soak-") as folder:
        for one in soak(Path(folder), options.seconds, 3 * WARM_RENDERS):
            samples.append(one)
            if one.seconds - told >= ROW_SECONDS:
                print(row(one), flush=True)
                told = one.seconds
    print(row(samples[-1]))
    likely, surely = growth(samples)
    print(f"memory over the warm renders: {likely / 1e6:+.1f} MB (at 95 % more than {surely / 1e6:+.1f} MB)")
    wrong = complaints(samples)
    print("\n".join(wrong) or f"nothing grew and nothing was left behind in {samples[-1].renders} renders")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
