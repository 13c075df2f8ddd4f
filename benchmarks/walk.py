"""Speed of the photon walk on one core, beside the floor measured between its runs: `python -m benchmarks.walk`."""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.floor import Floor
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.scene.load import load_scene
from skinrender.skin.builder import build_volume
from skinrender.transport import tally

CONFIGS = Path(__file__).parents[1] / "configs"
THREE = "bands_nm=[450,550,650]"
FLAT = "relief={kind: flat}"
CASES = {
    "RED": ("slab_red", []),
    "BLUE": ("slab_blue", []),
    "RED matched": ("slab_red_matched", []),
    "forearm flat": ("fig10_forearm", [THREE, FLAT]),
    "forearm flat, macule": ("fig12_epidermal", [THREE, FLAT]),
    "forearm flat, deep lesion": ("fig14_deep", [THREE, FLAT]),
    "forearm relief": ("fig10_forearm", [THREE]),
    "forearm relief, macule": ("fig12_epidermal", [THREE]),
}


@dataclass(frozen=True)
class Timing:
    """Median over the runs, one band of one case."""

    case: str
    wavelength_nm: float
    storing: bool
    ratio: float
    ns_per_event: float
    floor_ns: float
    events_per_history: float
    nulls_per_event: float
    stored_per_second: float


def time_band(photon_pass: PhotonPass, case: str, band: int, storing: bool, floor: Floor, runs: int, histories: int) -> Timing:
    """Walk one band `runs` times, the floor before and after each run."""
    count = np.zeros(photon_pass.bands, np.int64)
    count[band] = histories
    layers = len(photon_pass.layer_names)
    ratios, times, floors = [], [], []
    before = floor.measure()
    for k in range(runs):
        began = time.thread_time()
        walked = photon_pass.walk(k, count, storing)
        spent = time.thread_time() - began
        after = floor.measure()
        counts = walked.tallies[band]
        events = counts[tally.scattered(layers)].sum() + counts[tally.absorbed(layers)].sum()
        times.append(spent / events * 1e9)
        floors.append(0.5 * (before + after))
        ratios.append(times[-1] / floors[-1])
        before = after
    return Timing(
        case, float(photon_pass.volume.wavelength_nm[band]), storing, statistics.median(ratios), statistics.median(times),
        statistics.median(floors), events / histories, counts[tally.COLLISIONS_NULL] / events,
        len(walked.position) / events / statistics.median(times) * 1e9,
    )  # fmt: skip


def run(cases: list[str], runs: int, histories: int) -> list[Timing]:
    """Time all bands of some cases, without and with storing."""
    floor = Floor()
    timings = []
    for case in cases:
        config, overrides = CASES[case]
        scene = load_scene(CONFIGS / f"{config}.yaml", overrides)
        volume = build_volume(scene)
        photon_pass = PhotonPass(volume, light_from_scene(scene), 1)
        for storing in (False, True):
            photon_pass.walk(0, np.full(photon_pass.bands, 10), storing)
            for band in range(photon_pass.bands):
                timings.append(time_band(photon_pass, case, band, storing, floor, runs, histories))
    return timings


def table(timings: list[Timing]) -> str:
    """Rows by case and band, and the mean of the bands."""
    lines = [
        f"{'scene':26} {'nm':>5} {'storing':>7} {'x floor':>7} {'ns/event':>8} {'floor':>6} {'events':>7} {'null':>6} "
        f"{'M stored/s':>10}"
    ]
    for t in timings:
        lines.append(
            f"{t.case:26} {t.wavelength_nm:5.0f} {'yes' if t.storing else 'no':>7} {t.ratio:7.2f} {t.ns_per_event:8.1f} "
            f"{t.floor_ns:6.1f} {t.events_per_history:7.1f} {t.nulls_per_event:6.3f} {t.stored_per_second / 1e6:10.1f}"
        )
    for case in dict.fromkeys(t.case for t in timings):
        for storing in (False, True):
            some = [t for t in timings if t.case == case and t.storing == storing]
            mean = statistics.mean(t.ratio for t in some)
            ns = statistics.mean(t.ns_per_event for t in some)
            lines.append(f"{case:26}  mean {'yes' if storing else 'no':>7} {mean:7.2f} {ns:8.1f}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", default=list(CASES), help=f"of {', '.join(CASES)}")
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--histories", type=int, default=8000)
    options = parser.parse_args()
    print(table(run(options.cases, options.runs, options.histories)))


if __name__ == "__main__":
    main()
