"""Pictures against Mitsuba and absorption against MCX, through `skinrender export`: `python -m benchmarks.cross_check`.

Needs `mitsuba`; `pmcx`, `pmcxcl`, `jdata` and an OpenCL device (extra `interop`). A program that is not there is told
and left out. Each comparison is by z: difference over both standard errors, those of the others from runs of several
seeds.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import multiprocessing
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from skinrender.engine.estimate import estimate
from skinrender.engine.trace import trace
from skinrender.estimate.scatter_image import MOST_BATCHES
from skinrender.export.mcx import write_mcx
from skinrender.export.mitsuba import write_mitsuba
from skinrender.film.color import MM2_PER_M2
from skinrender.film.spectral_image import SpectralImage
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_map import open_map
from skinrender.scene import load_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import load_volume, save_volume

CONFIGS = Path(__file__).parents[1] / "configs"
LARGEST_Z = 4.0
_HEAD = ("| case | quantity | skinrender | the other | z |", "|---|---|---|---|---|")

_LAYERED = """
patch: {{size_mm: [2, 2], columns: [1, 1]}}
bands_nm: [550]
slab:
  layers:
    - {{name: top, thickness_mm: 0.1, mu_a_per_mm: 2, mu_s_per_mm: 20, g: 0.8, refractive_index: {n}}}
    - {{name: middle, thickness_mm: 0.4, mu_a_per_mm: 0.1, mu_s_per_mm: 15, g: 0.7, refractive_index: {n}}}
    - {{name: bottom, thickness_mm: 0.5, mu_a_per_mm: 0.5, mu_s_per_mm: 10, g: 0.9, refractive_index: {n}}}
below: {{refractive_index: 1.0}}
light: {{kind: {light}, spectrum: E}}
photons: {{roulette: false}}
"""
_LEVEL = (
    "relief={kind: flat}", "skin.border_wave.peak_to_valley_um=0", "bands_nm=[540]", "photons.roulette=false",
)  # fmt: skip
_SKIN = (
    *_LEVEL, "sides=open", "light={kind: sky, spectrum: E}", "camera.pixels=[16, 16]", "finish.roughness=0.01",
)  # fmt: skip


@dataclass(frozen=True)
class Picture:
    """A scene that is compared pixel by pixel: its config; share : of Mitsuba's paths, which are slow through voxels."""

    config: str
    overrides: tuple[str, ...]
    share: float = 1.0


PICTURES = {
    "matched block, point light": Picture("slab_red_matched", ("camera.pixels=[16, 16]", "photons.roulette=false")),
    "block of n = 1.4, sky": Picture(
        "slab_red",
        ("camera.pixels=[16, 16]", "camera.cross_polarized=false", "light={kind: sky, spectrum: E}", "finish.roughness=0.01",
         "photons.roulette=false"),
    ),
    "macule on forearm, 540 nm, sky": Picture("smoke_beam", _SKIN, share=0.25),
}  # fmt: skip


@dataclass(frozen=True)
class Walk:
    """A scene whose absorption is compared: its text or config, and the edge of MCX's cubes, which its layers fill.

    share : of the photons asked for; small cubes take long.
    """

    scene: str
    overrides: tuple[str, ...] = ()
    edge_mm: float = 0.05
    share: float = 1.0

    def load(self, folder: Path, stored: float) -> Any:
        path = CONFIGS / self.scene
        if self.scene.startswith("\n"):
            path = folder / "scene.yaml"
            path.write_text(self.scene, encoding="utf-8")
        return load_scene(path, (*self.overrides, f"photons.stored={stored}"))


WALKS = {
    "matched, parallel light": Walk(_LAYERED.format(n=1.0, light="collimated")),
    "n = 1.4, parallel light": Walk(_LAYERED.format(n=1.4, light="collimated"), edge_mm=0.025),
    "n = 1.4, sky": Walk(_LAYERED.format(n=1.4, light="sky"), edge_mm=0.025),
    "forearm, 540 nm, point light": Walk(
        "smoke_beam.yaml",
        (
            *_LEVEL,
            "lesions=[]",
            "patch={size_mm: [0.5, 0.5], columns: [2, 2]}",
        ),
        edge_mm=0.005,
        share=0.1,
    ),
}


@dataclass(frozen=True)
class Row:
    """One number of two programs: values and standard errors."""

    case: str
    quantity: str
    ours: float
    ours_stderr: float
    theirs: float
    theirs_stderr: float

    @property
    def z(self) -> float:
        error = math.hypot(self.ours_stderr, self.theirs_stderr)
        return (self.ours - self.theirs) / error if error else math.inf

    def line(self) -> str:
        """The row of a table in Markdown."""
        ours, theirs = (
            f"{v:.5g} ± {e:.2g}" for v, e in ((self.ours, self.ours_stderr), (self.theirs, self.theirs_stderr))
        )
        return f"| {self.case} | {self.quantity} | {ours} | {theirs} | {self.z:+.2f} |"


def picture_rows(case: str, options: argparse.Namespace, folder: Path) -> list[Row]:
    """Mean radiance, and the pixels' z, of our reference and beam estimates and of Mitsuba's path tracer."""
    picture = PICTURES[case]
    scene = load_scene(CONFIGS / f"{picture.config}.yaml", (*picture.overrides, f"photons.stored={options.stored}"))
    save_volume(build_volume(scene), folder / "volume.npz")
    volume = load_volume(folder / "volume.npz")
    trace(scene, folder / "volume.npz", folder, progress=False)
    nm = float(volume.wavelength_nm[0])
    samples = round(picture.share * options.samples)
    written = write_mitsuba(volume, light_from_scene(scene), scene.camera, nm, folder / "scene.xml", samples)
    with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as pool:
        theirs = np.array(list(pool.map(partial(mitsuba_picture, written.scene, samples), range(options.seeds))))
    rows = []
    for method in ("reference", "beam"):
        image, summary = estimate(scene, volume, open_map(folder / "photons.npz"), method=method, progress=False)
        mean, z = summary.as_json()["mean_radiance"], pixel_z(image, theirs)
        told = f"{z.size} pixels: mean z {z.mean():+.2f}, rms {math.sqrt(np.mean(z**2)):.2f}, largest {np.abs(z).max():.2f}"
        rows.append(
            Row(
                case, f"mean radiance, {method} ({told})", mean["value"], mean["stderr"], *_mean_of(theirs.mean((1, 2)))
            )
        )
    return rows


def mitsuba_picture(scene: Path, samples: int, seed: int) -> np.ndarray:
    """Radiance (h, w) by Mitsuba's path tracer. A process each: it shares out blocks of 32 x 32 pixels, larger than these."""
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    return np.array(mitsuba.render(mitsuba.load_file(str(scene)), spp=samples, seed=seed))[..., 0]


def absorption_rows(case: str, options: argparse.Namespace, folder: Path) -> list[Row]:
    """Share of the light that entered which each layer absorbs, here and in MCX."""
    import pmcx
    import pmcxcl

    walk = WALKS[case]
    scene = walk.load(folder, options.stored)
    save_volume(build_volume(scene), folder / "volume.npz")
    volume = load_volume(folder / "volume.npz")
    ours = trace(scene, folder / "volume.npz", folder, progress=False).as_json()
    file = folder / "mcx.json"
    nm, photons = float(volume.wavelength_nm[0]), round(walk.share * options.photons)
    write_mcx(volume, light_from_scene(scene), nm, file, edge_mm=walk.edge_mm, photons=photons, seed=1)
    cfg = pmcx.json2mcx(str(file)) | {"flog": "none"}
    z = walk.edge_mm * (np.arange(np.shape(cfg["vol"])[2]) + 0.5)
    layer = np.searchsorted(volume.border_z_mm, z) - 1
    theirs = []
    for seed in range(1, options.seeds + 1):
        with silent_output():
            energy = pmcxcl.run(cfg | {"seed": seed})["flux"].sum(axis=(0, 1, 3))
        theirs.append([energy[layer == k].sum() for k in range(len(volume.layer_name) - 1)])
    entered = 1.0 - ours["specular"]["value"]
    return [
        Row(case, f"absorbed in {name}", part["value"] / entered, part["stderr"] / entered, *_mean_of(values))
        for (name, part), values in zip(ours["absorbed"].items(), np.transpose(theirs))
    ]


@contextmanager
def silent_output() -> Iterator[None]:
    """Without what a library prints by itself: MCX tells some 50 lines of each run."""
    sys.stdout.flush()
    kept = os.dup(1)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def pixel_z(image: SpectralImage, theirs: np.ndarray) -> np.ndarray:
    """Normal z of each pixel's difference: Welch's t, whose few runs have long tails, brought to a normal's quantiles.

    theirs : (runs, height, width) pictures of independent seeds.
    """
    ours, runs = image.stderr_Y / MM2_PER_M2, len(theirs)
    their = theirs.std(axis=0, ddof=1) / math.sqrt(runs)
    t = (image.radiance[..., 0] - theirs.mean(axis=0)) / np.hypot(ours, their)
    freedom = (ours**2 + their**2) ** 2 / (ours**4 / (MOST_BATCHES - 1) + their**4 / (runs - 1))
    return np.sign(t) * stats.norm.isf(stats.t.sf(np.abs(t), freedom))


def _mean_of(values: np.ndarray) -> tuple[float, float]:
    return float(np.mean(values)), float(np.std(values, ddof=1) / math.sqrt(len(values)))


def _missing(modules: Sequence[str]) -> list[str]:
    return [name for name in modules if importlib.util.find_spec(name) is None]


def main() -> None:
    """Print a table; exit 1 where |z| of a total is larger than 4."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/cross_check"))
    parser.add_argument("--samples", type=int, default=256, help="paths a pixel and seed of Mitsuba")
    parser.add_argument("--photons", type=int, default=100_000, help="photons a seed of MCX")
    parser.add_argument("--seeds", type=int, default=16, help="runs of either")
    parser.add_argument("--stored", type=float, default=1e7, help="photons that skinrender stores")
    parser.add_argument("--only", choices=("mitsuba", "mcx"))
    options = parser.parse_args()
    rows: list[Row] = []
    print(*_HEAD, sep="\n", flush=True)
    programs = (
        ("mitsuba", ("mitsuba",), PICTURES, picture_rows),
        ("mcx", ("pmcx", "pmcxcl", "jdata"), WALKS, absorption_rows),
    )
    for program, modules, cases, compare in programs:
        if options.only not in (None, program):
            continue
        if missing := _missing(modules):
            print(f"{program} left out: {', '.join(missing)} not installed", file=sys.stderr)
            continue
        for number, case in enumerate(cases):
            folder = options.output / f"{program}_{number}"
            folder.mkdir(parents=True, exist_ok=True)
            compared = compare(case, options, folder)
            print(*(row.line() for row in compared), sep="\n", flush=True)
            rows += compared
    table = "\n".join([*_HEAD, *(row.line() for row in rows)])
    (options.output / "cross_check.md").write_text(table + "\n")
    (options.output / "cross_check.json").write_text(json.dumps([{**vars(row), "z": row.z} for row in rows], indent=1))
    if any(abs(row.z) > LARGEST_Z for row in rows):
        sys.exit(1)


if __name__ == "__main__":
    main()
