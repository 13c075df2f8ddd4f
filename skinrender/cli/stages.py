"""The three stages, as the commands `build`, `trace`, `estimate` and `render` run them."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from skinrender.cli.console import Row, bytes_text, with_error
from skinrender.cli.current import BUILD_SOURCES, estimate_provenance, program_hash
from skinrender.cli.job import Job

if TYPE_CHECKING:
    from skinrender.photonmap.photon_map import PhotonMap
    from skinrender.skin.volume import SkinVolume


def run_build(job: Job) -> SkinVolume:
    """Build the volume and write it with its section."""
    from skinrender.engine.lock import folder_lock
    from skinrender.skin.builder import build_volume
    from skinrender.skin.section import draw_section
    from skinrender.skin.volume import load_volume, save_volume

    with folder_lock(job.out):
        with job.clock.stage("load"):
            volume = build_volume(job.scene)
            program = {"program": program_hash(BUILD_SOURCES)}
            save_volume(replace(volume, provenance=volume.provenance | program), job.volume)
        with job.clock.stage("write"):
            draw_section(volume, job.section)
    return load_volume(job.volume)


def run_trace(job: Job, workers: int | None, resume: bool, shard: tuple[int, int] | None = None) -> dict[str, Any]:
    """Trace the photons; returns the summary that ``trace --json`` prints."""
    from skinrender.engine.trace import trace

    summary = trace(
        job.scene, job.volume, job.out,
        workers=workers, resume=resume, shard=shard, progress=job.console.progress, clock=job.clock,
    )  # fmt: skip
    return summary.as_json()


def run_estimate(
    job: Job, volume: SkinVolume, photon_map: PhotonMap, reflectance: bool, workers: int | None
) -> dict[str, Any]:
    """Estimate the picture and write it; returns the summary that ``estimate --json`` prints."""
    from skinrender.engine.estimate import estimate
    from skinrender.engine.lock import folder_lock
    from skinrender.film.exr import write_exr
    from skinrender.film.png import write_png

    with folder_lock(job.out):
        image, summary = estimate(
            job.scene, volume, photon_map, threads=workers, progress=job.console.progress, clock=job.clock
        )
        told = {key: value for key, value in summary.as_json().items() if key != "seconds"}
        told = {key: None if _undefined(value) else value for key, value in told.items()}
        with job.clock.stage("write"):
            told["clipped_fraction"] = write_png(job.png, image.display_rgb())
            provenance = estimate_provenance(job, photon_map, reflectance) | {"summary": told}
            write_exr(job.exr, replace(image, provenance=provenance), reflectance=reflectance)
    if told["nan_pixels"]:
        job.console.warn(f"{told['nan_pixels']} pixels of {job.exr} are not finite")
    return told


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


def estimate_rows(summary: Mapping[str, Any]) -> list[Row]:
    """The picture in a table."""
    noise, clipped = summary["stderr_relative_mean"], summary["clipped_fraction"]
    rows = [
        ("method", summary["method"]),
        ("mean radiance", f"{_scientific(summary['mean_radiance'])} W mm^-2 sr^-1"),
        ("photons gathered", f"{summary['photons_gathered_mean']:.4g} on average"),
        ("noise of a pixel", "unknown" if noise is None else f"{100 * noise:.2g} % of its luminance on average"),
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
