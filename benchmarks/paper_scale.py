"""The paper's whole figure 10, by beam and by point, beside its table 1: `python -m benchmarks.paper_scale`.

A 10 mm forearm with its furrows under D65, 3.24e8 photons stored (all of them: no roulette), 200 x 200 pixels, 32,400
photons a beam or sample point. Also: how far each part is from what this machine can do at best, measured in the same
run, and the settings that reach the same noise soonest.
"""

from __future__ import annotations

import argparse
import json
import shutil
from dataclasses import asdict
from pathlib import Path

from benchmarks.limits import Limits, measure_limits
from benchmarks.resident import Watched, run_watched
from skinrender.analysis import table1
from skinrender.photonmap.photon_map import open_map
from skinrender.transport import tally

SCENE = Path(__file__).parents[1] / "configs" / "fig10_forearm.yaml"
METHODS = ("beam", "point")
MOST_DISK_BYTES = 4 << 30
SOONEST = {
    "beam, the scene's own settings": (),
    "point, the scene's own settings": ("--method", "point"),
}
"""Ways to a picture of the same noise: rounds go straight into it, with roulette, and the kernel is as wide as the
tissue allows."""


def render(method: str, photons: float, folder: Path) -> Watched:
    """Render the figure in an empty folder; fewer photons with the same kernel."""
    shutil.rmtree(folder, ignore_errors=True)
    return run_watched("render", str(SCENE), *table1.paper_options(method, photons), "-o", str(folder))


def events_of(path: Path) -> int:
    """Scattering and absorption events of all histories of a map."""
    photon_map = open_map(path, verify=False)
    layers = len(photon_map.layer_name)
    counts = photon_map.tallies.sum(axis=(0, 1))
    return int(counts[tally.scattered(layers)].sum() + counts[tally.absorbed(layers)].sum())


def run_table(done: dict[str, Watched], map_bytes: int) -> str:
    """What each method took beside its picture."""
    rows = {
        "wall seconds of the process": [f"{w.seconds:.1f}" for w in done.values()],
        "CPU seconds": [f"{w.cpu_seconds:.1f}" for w in done.values()],
        "peak resident, GB": [f"{w.peak.total / 1e9:.2f}" for w in done.values()],
        "of it not pages of files, GB": [f"{w.peak.own / 1e9:.2f}" for w in done.values()],
        "photons stored": [f"{w.summary['photons_stored']:.4g}" for w in done.values()],
        "photons gathered, mean": [f"{w.summary['photons_gathered_mean']:.0f}" for w in done.values()],
        "noise of a pixel": [f"{w.summary['stderr_relative_mean']:.3%}" for w in done.values()],
        "photons.npz, GB": [f"{map_bytes / 1e9:.2f}"] * len(done),
    }
    lines = [f"{'':30}" + "".join(f"{name:>12}" for name in done)]
    return "\n".join(lines + [f"{name:30}" + "".join(f"{cell:>12}" for cell in cells) for name, cells in rows.items()])


def limit_table(done: dict[str, Watched], limits: Limits, events: int, map_bytes: int) -> str:
    """Seconds of each part at the limit of what bounds it, beside the measured."""
    walk = events * limits.walk_ns * 1e-9 / limits.cores
    disk, memory = 2 * map_bytes / limits.disk_write, map_bytes / limits.memory
    read, in_memory = map_bytes / limits.disk_read, f"{map_bytes / 1e9:.1f} GB at {limits.memory / 1e9:.1f} GB/s"
    rows = [
        ("trace: bare walk", f"{events:.3g} events at {limits.walk_ns:.1f} ns", walk, "trace", "beam"),
        ("trace: disk", f"{2 * map_bytes / 1e9:.1f} GB at {limits.disk_write / 1e6:.0f} MB/s", disk, "trace", "beam"),
        *((f"estimate, {name}: memory", in_memory, memory, "estimate", name) for name in done),
        ("map from the disk", f"{map_bytes / 1e9:.1f} GB at {limits.disk_read / 1e6:.0f} MB/s", read, "", ""),
    ]
    lines = [f"{'part':24} {'limit':30} {'limit s':>8} {'stage s':>8} {'x limit':>8}"]
    for part, what, least, stage, name in rows:
        took = done[name].summary["seconds"][stage] if name else None
        told = f"{took:8.1f} {took / least:8.1f}" if took is not None else ""
        lines.append(f"{part:24} {what:30} {least:8.2f} {told}".rstrip())
    return "\n".join(lines)


def soonest_table(noise: float, folder: Path) -> str:
    """Seconds until the beam's noise is reached by other settings."""
    lines = [f"{f'noise {noise:.3%} by':30} {'photons':>12} {'noise':>8} {'seconds':>8} {'process':>8}"]
    for name, options in SOONEST.items():
        shutil.rmtree(folder, ignore_errors=True)
        done = run_watched("render", str(SCENE), "--target-error", repr(noise), "-o", str(folder), *options)
        told = done.summary
        lines.append(
            f"{name:30} {told['photons_stored']:12.4g} {told['stderr_relative_mean']:8.3%} "
            f"{told['seconds']['total']:8.1f} {done.seconds:8.1f}"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photons", type=float, default=table1.PAPER_PHOTONS, help="fewer for a try")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/paper_scale"))
    options = parser.parse_args()
    out = options.output
    out.mkdir(parents=True, exist_ok=True)
    for method in METHODS:
        render(method, min(1e5, options.photons), out / "warm")  # compiles the kernels
    shutil.rmtree(out / "warm")
    done, events, map_bytes = {}, 0, 0
    for method in METHODS:
        done[method] = render(method, options.photons, out / method)
        photons = out / method / "photons.npz"
        events, map_bytes = events_of(photons), photons.stat().st_size
        photons.unlink()
    limits = measure_limits(out, min(MOST_DISK_BYTES, map_bytes))
    print(f"\nTable 1; the paper's: {table1.PAPER_HARDWARE}\n")
    print(table1.table(*(table1.seconds_of(out / method) for method in ("point", "beam"))))
    print("\n" + run_table(done, map_bytes))
    print("\n" + limit_table(done, limits, events, map_bytes))
    print("\n" + soonest_table(done["beam"].summary["stderr_relative_mean"], out / "soonest"))
    told = {name: asdict(watched) for name, watched in done.items()} | {"limits": asdict(limits)}
    told |= {"events": events, "map_bytes": map_bytes}
    (out / "paper_scale.json").write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
