"""Speed of the photon walk on one core, beside the floor measured between its runs: `python -m benchmarks.walk`.

Single bands one after the other, and the rounds of renders: all 81 bands with few histories each.
"""

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
WHOLE = {
    "fig. 12 flat, 200 a band": ("fig12_epidermal", [FLAT], 200),
    "fig. 12, 200 a band": ("fig12_epidermal", [], 200),
    "fig. 12, 1000 a band": ("fig12_epidermal", [], 1000),
}
"""Rounds with roulette on storage: 200 histories a band are a round of the first part of `render --target-error`, 1000 of 5e7
photons."""


@dataclass(frozen=True)
class Timing:
    """Median over the runs, one band of one case or all together."""

    case: str
    band: str
    storing: bool
    ratio: float
    ns_per_event: float
    floor_ns: float
    events_per_history: float
    nulls_per_event: float
    stored_per_second: float


def time_walk(photon_pass: PhotonPass, case: str, band: str, storing: bool, floor: Floor, runs: int, count: np.ndarray) -> Timing:
    """Walk count (B,) histories `runs` times, the floor before and after each run."""
    layers = len(photon_pass.layer_names)
    ratios, times, floors = [], [], []
    before = floor.measure()
    for k in range(runs):
        began = time.thread_time()
        walked = photon_pass.walk(k, count, storing)
        spent = time.thread_time() - began
        after = floor.measure()
        counts = walked.tallies.sum(axis=0)
        events = counts[tally.scattered(layers)].sum() + counts[tally.absorbed(layers)].sum()
        times.append(spent / events * 1e9)
        floors.append(0.5 * (before + after))
        ratios.append(times[-1] / floors[-1])
        before = after
    return Timing(
        case, band, storing, statistics.median(ratios), statistics.median(times),
        statistics.median(floors), events / count.sum(), counts[tally.COLLISIONS_NULL] / events,
        len(walked.position) / events / statistics.median(times) * 1e9,
    )  # fmt: skip


def make_pass(config: str, overrides: list[str], roulette: bool = False) -> PhotonPass:
    """The photon pass of a scene, its kernels compiled."""
    scene = load_scene(CONFIGS / f"{config}.yaml", overrides)
    photon_pass = PhotonPass(build_volume(scene), light_from_scene(scene), 1, roulette=roulette)
    for storing in (False, True):
        photon_pass.walk(0, np.full(photon_pass.bands, 10), storing)
    return photon_pass


def run(cases: list[str], runs: int, histories: int) -> list[Timing]:
    """Time each band of some cases, or all together, without and with storing."""
    floor = Floor()
    timings = []
    for case in cases:
        if case in WHOLE:
            config, overrides, each = WHOLE[case]
            photon_pass = make_pass(config, overrides, roulette=True)
            counts = {"all": np.full(photon_pass.bands, each)}
        else:
            photon_pass = make_pass(*CASES[case])
            one = np.diag(np.full(photon_pass.bands, histories))
            counts = {f"{nm:.0f}": one[band] for band, nm in enumerate(photon_pass.volume.wavelength_nm)}
        for storing in (False, True):
            for band, count in counts.items():
                timings.append(time_walk(photon_pass, case, band, storing, floor, runs, count))
    return timings


def table(timings: list[Timing]) -> str:
    """Rows by case and band, and the mean of the bands."""
    lines = [
        f"{'scene':26} {'nm':>5} {'storing':>7} {'x floor':>7} {'ns/event':>8} {'floor':>6} {'events':>7} {'null':>6} "
        f"{'M events/s':>10} {'M stored/s':>10}"
    ]
    for t in timings:
        lines.append(
            f"{t.case:26} {t.band:>5} {'yes' if t.storing else 'no':>7} {t.ratio:7.2f} {t.ns_per_event:8.1f} "
            f"{t.floor_ns:6.1f} {t.events_per_history:7.1f} {t.nulls_per_event:6.3f} "
            f"{1e3 / t.ns_per_event:10.1f} {t.stored_per_second / 1e6:10.1f}"
        )
    for case in dict.fromkeys(t.case for t in timings if t.case in CASES):
        for storing in (False, True):
            some = [t for t in timings if t.case == case and t.storing == storing]
            mean = statistics.mean(t.ratio for t in some)
            ns = statistics.mean(t.ns_per_event for t in some)
            lines.append(f"{case:26}  mean {'yes' if storing else 'no':>7} {mean:7.2f} {ns:8.1f}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    names = [*CASES, *WHOLE]
    parser.add_argument("cases", nargs="*", default=names, help=f"of {', '.join(names)}")
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--histories", type=int, default=16_000, help="of a single band; the last ones fly in an emptying block")
    options = parser.parse_args()
    print(table(run(options.cases, options.runs, options.histories)))


if __name__ == "__main__":
    main()
