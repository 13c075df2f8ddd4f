"""The three stages, as the commands `build`, `trace`, `estimate` and `render` run them."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from skinrender.cli.console import Row, with_error
from skinrender.cli.current import estimate_provenance
from skinrender.cli.job import Job
from skinrender.files import bytes_text

if TYPE_CHECKING:
    from skinrender.engine.cluster import Cluster
    from skinrender.engine.estimate import EstimateSummary
    from skinrender.film.spectral_image import SpectralImage
    from skinrender.photonmap.photon_map import PhotonMap
    from skinrender.skin.volume import SkinVolume


def run_build(job: Job) -> SkinVolume:
    """Build the volume and write it with its section."""
    from skinrender.engine.lock import folder_lock
    from skinrender.skin.section import draw_section

    with folder_lock(job.out):
        volume = _build(job)
        with job.clock.stage("write"):
            draw_section(volume, job.section)
    return volume


def build_alone(job: Job) -> SkinVolume:
    """Build the volume and write it; its section is still to be drawn, see `section_beside`."""
    from skinrender.engine.lock import folder_lock

    with folder_lock(job.out):
        return _build(job)


def _build(job: Job) -> SkinVolume:
    """Build the volume and write it; it has no section then, not even an older one's."""
    from skinrender.atomic import remove
    from skinrender.skin.builder import build_volume
    from skinrender.skin.volume import load_volume, save_volume

    with job.clock.stage("load"):
        remove(job.section)
        save_volume(build_volume(job.scene), job.volume)
        return load_volume(job.volume)


def run_trace(
    job: Job, workers: int | None, resume: bool, shard: tuple[int, int] | None = None, scheduler: str | None = None
) -> dict[str, Any]:
    """Trace the photons, here or on a cluster; returns the summary that ``trace --json`` prints."""
    from skinrender.engine.trace import trace

    with _cluster(scheduler) as cluster:
        summary = trace(
            job.scene, job.volume, job.out, workers=cluster.slots if cluster else workers, resume=resume, shard=shard,
            progress=job.console.progress, clock=job.clock, open_executor=cluster.open_executor if cluster else None,
        )  # fmt: skip
    return summary.as_json()


@contextlib.contextmanager
def _cluster(scheduler: str | None) -> Iterator[Cluster | None]:
    """The cluster of a scheduler's address, None without one."""
    if scheduler is None:
        yield None
        return
    from skinrender.engine.cluster import connect

    with connect(scheduler) as cluster:
        yield cluster


def run_estimate(
    job: Job,
    volume: SkinVolume,
    photon_map: PhotonMap,
    reflectance: bool,
    workers: int | None,
    scheduler: str | None = None,
) -> dict[str, Any]:
    """Estimate the picture, here or on a cluster, and write it; returns the summary that ``estimate --json`` prints."""
    from skinrender.engine.estimate import estimate
    from skinrender.engine.lock import folder_lock

    with folder_lock(job.out), _cluster(scheduler) as cluster:
        image, summary = estimate(
            job.scene, volume, photon_map, threads=workers, progress=job.console.progress, clock=job.clock,
            cluster=cluster, volume_path=job.volume,
        )  # fmt: skip
        return write_picture(job, image, summary, reflectance)


def write_picture(job: Job, image: SpectralImage, summary: EstimateSummary, reflectance: bool) -> dict[str, Any]:
    """Write a picture as EXR and PNG; returns the summary that ``estimate --json`` prints."""
    from skinrender.film.exr import write_exr
    from skinrender.film.png import write_png

    told = {key: value for key, value in summary.as_json().items() if key != "seconds"}
    told = {key: None if _undefined(value) else value for key, value in told.items()}
    with job.clock.stage("write"):
        told["clipped_fraction"] = write_png(job.png, image.display_rgb())
        provenance = estimate_provenance(job, image.provenance["photon_map"], reflectance) | {"summary": told}
        write_exr(job.exr, replace(image, provenance=provenance), reflectance=reflectance)
    if told["nan_pixels"]:
        job.console.warn(f"{told['nan_pixels']} pixels of {job.exr} are not finite")
    return told


@contextlib.contextmanager
def section_beside(job: Job, volume: SkinVolume) -> Iterator[None]:
    """Draw the volume's section, if there is none, while the block runs."""
    from skinrender.skin.section import draw_section

    if job.section.is_file():
        yield
        return
    with ThreadPoolExecutor(1) as pool:
        drawn = pool.submit(draw_section, volume, job.section)
        yield
        with job.clock.stage("write"):
            drawn.result()


def run_until(
    job: Job,
    volume: SkinVolume,
    target_error: float | None,
    seconds: float | None,
    reflectance: bool,
    threads: int | None,
) -> dict[str, Any]:
    """Walk and estimate until the picture is good enough or its time is over; returns both summaries in one.

    `seconds` are counted from the beginning of the job.
    """
    from skinrender.engine.ahead import kernels_ahead
    from skinrender.engine.lock import folder_lock
    from skinrender.engine.progressive import Goal, render_until
    from skinrender.engine.recipe import scene_recipe

    told: dict[str, Any] = {}

    def show(image: SpectralImage, summary: EstimateSummary) -> None:
        told.update(write_picture(job, image, summary, reflectance))
        noise = told["stderr_relative_mean"]
        rounds = image.provenance["photon_map"]["rounds"]
        job.console.detail(
            f"{rounds} rounds: noise of a pixel " + ("unknown" if noise is None else f"{100 * noise:.2g} %")
        )

    goal = Goal(target_error, None if seconds is None else job.began + seconds)
    with folder_lock(job.out), section_beside(job, volume), kernels_ahead(job.scene, job.volume) as compiled:
        traced = render_until(
            goal, job.scene, volume, scene_recipe(job.scene, job.volume), show, threads=threads, compiled=compiled,
            progress=job.console.progress, clock=job.clock,
        )  # fmt: skip
    return traced.as_json() | told


def volume_summary(job: Job, volume: SkinVolume) -> dict[str, Any]:
    """What ``build --json`` prints."""
    return {
        "voxels": list(volume.shape),
        "size_mm": [*volume.size_mm, float(volume.border_z_mm[-1])],
        "layers": list(volume.layer_name[1:]),
        "bands": len(volume.wavelength_nm),
        "palette_entries": len(volume.palette_layer),
        "volume_bytes": job.volume.stat().st_size,
        "hash": volume.provenance.get("hash"),
    }


def volume_rows(summary: Mapping[str, Any]) -> list[Row]:
    """The volume in a table."""
    return [
        ("voxels", " x ".join(map(str, summary["voxels"])) + f" in {bytes_text(summary['volume_bytes'])}"),
        ("size", " x ".join(f"{length:g}" for length in summary["size_mm"]) + " mm"),
        ("layers", ", ".join(summary["layers"])),
        ("bands", f"{summary['bands']}; {summary['palette_entries']} kinds of voxel"),
    ]


def trace_rows(summary: Mapping[str, Any], by_wavelength: bool = False) -> list[Row]:
    """What became of the light, in a table."""
    stored, emitted, rounds = (summary[key] for key in ("photons_stored", "photons_emitted", "rounds"))
    rows = [("photons", f"{stored} stored of {emitted} emitted, in {rounds} rounds")]
    rows += [(name, with_error(summary[name])) for name in ("reflectance", "specular", "transmittance", "sides")]
    rows += [(f"absorbed in {layer}", with_error(part)) for layer, part in summary["absorbed"].items()]
    if by_wavelength:
        rows += [
            (f"reflectance at {band['wavelength_nm']:g} nm", with_error(band["reflectance"]))
            for band in summary["by_wavelength"]
        ]
    return rows


_REMAINING = {"left_out": "light left out, about", "mesh": "bias of the mesh of rays"}


def estimate_rows(summary: Mapping[str, Any]) -> list[Row]:
    """The picture in a table."""
    noise, clipped = summary["stderr_relative_mean"], summary["clipped_fraction"]
    rows = [
        ("method", summary["method"]),
        ("mean radiance", f"{_scientific(summary['mean_radiance'])} W mm^-2 sr^-1"),
        ("photons gathered", f"{summary['photons_gathered_mean']:.4g} on average"),
        ("noise of a pixel", "unknown" if noise is None else f"{100 * noise:.2g} % of its luminance on average"),
    ]
    rows += [
        (_REMAINING[name], f"{100 * part['value']:.2g} ± {100 * (part['stderr'] or 0.0):.1g} % of the mean")
        for name, part in summary.get("remaining_bias", {}).items()
    ]
    if clipped:
        rows.append(("clipped in the PNG", f"{100 * clipped:.2g} % of the pixels; the EXR holds them as they are"))
    return rows


def _scientific(pair: Mapping[str, float | None]) -> str:
    """A value of any size with its standard error."""
    value, error = pair["value"], pair["stderr"]
    if not error or not value:
        return f"{value:.6g}"
    scale = 10.0 ** math.floor(math.log10(abs(value)))
    return f"({with_error({'value': value / scale, 'stderr': error / scale})})e{math.log10(scale):+.0f}"


def _undefined(value: Any) -> bool:
    with contextlib.suppress(TypeError):
        return not math.isfinite(value)
    return False
