"""Speed of the estimates: `python -m benchmarks.estimate`.

First, on one walked map: nanoseconds of the estimate's CPU time for each photon looked at and for each pair of a photon
and a beam (or sample point) that meet. Second, from nothing to a picture: seconds until the noise of the luminance, the
mean over the pixels of (standard error / value)^2 less a border of 4 pixels, is 1e-3; and its mean against the one that
unbiased camera path tracing with refracted next-event estimation has on the same scene (own computation, +-0.05 %).
Third, noise of color against photons and seconds, with one kernel for all and with a wider one for the spectra's shape.
"""

from __future__ import annotations

import argparse
import math
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.engine.view import View
from skinrender.estimate.radius import WIDEST_MM, at_columns, lesion_absorbance
from skinrender.film.color import delta_e
from skinrender.film.spectral_image import SpectralImage
from skinrender.photonmap.from_rounds import map_from_rounds
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_map import PhotonMap
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.scene.load import load_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import SkinVolume

CONFIGS = Path(__file__).parents[1] / "configs"
ROUNDS, WANTED, BORDER = 20, 1e-3, 4
CASES = {
    "slab_red": (90_000, 0.43623), "slab_blue": (170_000, 0.22302), "slab_red_matched": (90_000, 0.54431),
    "slab_blue_matched": (170_000, 0.33851), "fig12_epidermal": (2000, None),
}  # fmt: skip
"""Histories of a band and round near the wanted noise; mean radiance known, W mm^-2 sr^-1."""
COLORED, COLOR_HISTORIES = ("fig12_epidermal", "fig14_deep", "freckles", "mole", "tattoo"), (500, 2000)
MORE_THAN_THERE_ARE = 10**9
"""A gather count of the widest kernel, which is then that of the spectra too."""
PER_PHOTON = ("slab_red", "slab_blue", "fig12_epidermal")


@dataclass(frozen=True)
class Spent:
    """CPU and wall seconds."""

    cpu: float
    wall: float


@dataclass(frozen=True, eq=False)
class Case:
    """A scene ready to be walked."""

    scene: Any
    volume: SkinVolume
    threads: int

    def walk(self, histories: int, seed: int) -> PhotonMap:
        """Photons of `ROUNDS` rounds of so many histories a band."""
        photon_pass = PhotonPass(self.volume, light_from_scene(self.scene), seed, roulette=self.scene.photons.roulette)
        per_band = np.full(photon_pass.bands, histories)
        with ThreadPoolExecutor(self.threads) as pool:
            walked = list(pool.map(lambda index: photon_pass.walk(index, per_band, True), range(ROUNDS)))
        return map_from_rounds(photon_pass, walked)

    def picture(self, photons: PhotonMap, gather_count: int | None = None) -> SpectralImage:
        """What the camera sees by beam, from nothing but the volume."""
        view = View(self.scene, self.volume, "beam", gather_count, self.threads)
        return view.image(view.scattered(photons, False), {})


def open_case(name: str, threads: int) -> Case:
    """A shipped scene, its kernels compiled."""
    scene = load_scene(CONFIGS / f"{name}.yaml", [])
    case = Case(scene, build_volume(scene), threads)
    case.picture(case.walk(10, seed=0))
    return case


def clocked(work: Any) -> tuple[Any, Spent]:
    """Result of a function, and what it took."""
    cpu, wall = time.process_time(), time.perf_counter()
    result = work()
    return result, Spent(time.process_time() - cpu, time.perf_counter() - wall)


def per_photon(name: str, case: Case, histories: int) -> list[str]:
    """Rows of nanoseconds by method, on one map."""
    photons, few = case.walk(histories, seed=1), case.walk(10, seed=0)
    rows = []
    for method in ("beam", "point"):
        view = View(case.scene, case.volume, method, None, case.threads)
        view.scattered(few, False)
        _, fixed = clocked(lambda view=view: view.scattered(few, False))
        light, spent = clocked(lambda view=view: view.scattered(photons, False))
        samples = math.prod(case.scene.camera.pixels) * (view.lattice.rays.slabs if method == "point" else 1)
        own = 1e9 * max(spent.cpu - fixed.cpu, 0.0)
        rows.append(
            f"{name:18} {method:6} {len(photons) / 1e6:8.2f} {fixed.cpu:8.2f} {spent.cpu:8.2f} "
            f"{own / len(photons):10.1f} {own / (light.gathered * samples):10.3f}"
        )
    return rows


def noise_of(image: SpectralImage) -> tuple[float, float, np.ndarray]:
    """Claimed relMSE of the luminance, mean radiance, and luminance, less the border."""
    inner = slice(BORDER, -BORDER)
    y, stderr = image.y()[inner, inner].astype(float), image.stderr_Y[inner, inner]
    radiance = image.radiance[inner, inner].sum(axis=2, dtype=float).mean()
    return float(np.mean((stderr / y) ** 2)), float(radiance), y


def to_noise(name: str, case: Case, histories: int, known: float | None, seeds: int) -> list[str]:
    """A row a seed: seconds of walk and picture, the noise reached, seconds to 1e-3 as noise falls with 1 / photons."""
    rows, seen = [], []
    for seed in range(1, seeds + 1):
        photons, walk = clocked(lambda seed=seed: case.walk(histories, seed))
        image, show = clocked(lambda photons=photons: case.picture(photons))
        noise, mean, y = noise_of(image)
        seen.append(y)
        more = noise / WANTED
        wall, cpu = more * walk.wall + show.wall, more * walk.cpu + show.cpu
        bias = "" if known is None else f"{100.0 * (mean / known - 1.0):+10.2f}"
        rows.append(
            f"{name:18} {seed:4} {walk.wall:8.2f} {show.wall:8.2f} {noise:10.2e} {wall:10.2f} {0.5 * cpu:10.2f} "
            f"{bias:>10}"
        )
    if seeds > 1:
        true = np.mean([(a - b) ** 2 / (2.0 * np.mean(seen, axis=0) ** 2) for a, b in zip(seen, seen[1:])])
        rows.append(f"{name:18} noise between seeds {true:.2e}")
    return rows


def color_noise(name: str, case: Case, histories: int) -> str:
    """A row: CIEDE2000 of a pixel between two seeds over root 2, by one kernel for all and by a wider one for color."""
    one, two, seconds = [], [], []
    for seed in (1, 2):
        photons, walk = clocked(lambda seed=seed: case.walk(histories, seed))
        image, show = clocked(lambda photons=photons: case.picture(photons))
        seconds.append(walk.wall + show.wall)
        two.append(image.lab())
        one.append(case.picture(photons, MORE_THAN_THERE_ARE).lab())
    noise = [delta_e(*labs) / math.sqrt(2.0) for labs in (one, two)]
    inside = in_lesion(case)
    told = " ".join(f"{each.mean():10.2f} {each[inside].mean():10.2f}" for each in noise)
    return f"{name:18} {len(photons) / 1e6:9.2f} {np.mean(seconds):9.2f} {told}"


def in_lesion(case: Case) -> np.ndarray:
    """Pixels of a straight view above columns where lesions add half of the most that they do, (h, w)."""
    w, h = case.scene.camera.pixels
    x, y = ((np.arange(n) + 0.5) * size / n for n, size in zip((w, h), case.volume.size_mm))
    absorbance = lesion_absorbance(case.volume, WIDEST_MM)
    seen = at_columns(absorbance, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), case.volume.size_mm)
    return (seen > 0.5 * absorbance.max()).reshape(h, w)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    known = list(dict.fromkeys([*CASES, *COLORED]))
    parser.add_argument("scenes", nargs="*", default=known, help=f"of {', '.join(known)}")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    cases = {name: open_case(name, options.threads) for name in options.scenes}
    print("scene              method  M photons fixed s    CPU s  ns/photon    ns/pair", flush=True)
    for name in [name for name in PER_PHOTON if name in cases]:
        print("\n".join(per_photon(name, cases[name], max(1000, CASES[name][0] // 20))), flush=True)
    print("\nscene              seed   walk s picture s      noise  s to 1e-3    CPU / 2 mean off %", flush=True)
    for name in [name for name in CASES if name in cases]:
        print("\n".join(to_noise(name, cases[name], *CASES[name], options.seeds)), flush=True)
    print("\nscene              M photons   seconds   one kernel, inside   two kernels, inside (CIEDE2000)", flush=True)
    for name in [name for name in COLORED if name in cases]:
        for histories in COLOR_HISTORIES:
            print(color_noise(name, cases[name], histories), flush=True)


if __name__ == "__main__":
    main()
