"""The estimate stage: photon map and volume in, spectral picture out (paper, section 7.2)."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skinrender.engine.bands import scattered_apart
from skinrender.engine.clock import StageClock
from skinrender.engine.identity import file_hash
from skinrender.engine.recipe import VolumeFile
from skinrender.engine.view import (
    View,
    depth_edges,
    surface_subpixels,
    transmittance_subpixels,
    why_no_reflection,
)
from skinrender.estimate.beam import beam_bytes
from skinrender.estimate.lattice import lattice_bytes
from skinrender.estimate.point import point_bytes
from skinrender.estimate.ray_paths import paths_bytes
from skinrender.estimate.reference import reference_bytes
from skinrender.estimate.scatter_image import ScatteredLight, batch_stderr
from skinrender.estimate.surface import surface_bytes
from skinrender.estimate.transmittance import crossings_bytes
from skinrender.film.spectral_image import SpectralImage
from skinrender.photonmap.photon_map import PhotonMap
from skinrender.scene import Scene, about
from skinrender.skin.memory import require_memory
from skinrender.skin.regions import regions_of
from skinrender.skin.volume import SkinVolume

if TYPE_CHECKING:
    from skinrender.engine.cluster import Cluster


@dataclass(frozen=True, eq=False)
class EstimateSummary:
    """What the `estimate` command reports.

    Parameters
    ----------
    method : beam, point or reference.
    mean_radiance, mean_radiance_stderr : over all pixels, summed over bands, W mm^-2 sr^-1.
    nan_pixels : pixels with a value that is not finite.
    photons_gathered : photons met by a beam or a sample point, on average.
    stderr_relative_mean : mean over the lit pixels of the standard error of luminance over the luminance.
    remaining : of a reference, see `ScatteredLight`.
    seconds : by stage.
    """

    method: str
    mean_radiance: float
    mean_radiance_stderr: float
    nan_pixels: int
    photons_gathered: float
    stderr_relative_mean: float | None
    remaining: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """The object that ``skinrender estimate --json`` prints."""
        stderr = self.mean_radiance_stderr
        remaining = {
            name: {"value": value, "stderr": error if np.isfinite(error) else None}
            for name, (value, error) in self.remaining.items()
        }  # fmt: skip
        return ({"remaining_bias": remaining} if remaining else {}) | {
            "method": self.method,
            "mean_radiance": {"value": self.mean_radiance, "stderr": stderr if np.isfinite(stderr) else None},
            "nan_pixels": self.nan_pixels,
            "photons_gathered_mean": self.photons_gathered,
            "stderr_relative_mean": self.stderr_relative_mean,
            "seconds": dict(self.seconds),
        }


def estimate(
    scene: Scene,
    volume: SkinVolume,
    photon_map: PhotonMap,
    *,
    method: str | None = None,
    gather_count: int | None = None,
    threads: int | None = None,
    progress: bool = True,
    clock: StageClock | None = None,
    cluster: Cluster | None = None,
    volume_path: Path | None = None,
) -> tuple[SpectralImage, EstimateSummary]:
    """Estimate the picture of a scene from its photon map: spectral radiance of each pixel, and what is told of it.

    Parameters
    ----------
    scene : its camera, light, finish and estimate sections are read.
    volume, photon_map : the scene's.
    method : beam, point or reference, if other than the scene's.
    gather_count : photons that a beam or sample point meets on average, if other than the scene's.
    threads : of the estimate; all cores by default.
    progress : show a bar when on a terminal.
    clock : receives the seconds of the stage ``estimate``.
    cluster, volume_path : a `cluster.connect`ed one whose workers look at the photons, band by band; they are sent the
        volume's file.

    Raises
    ------
    InputError : a method that does not exist, borders that a view ray cannot be followed through, or more pixels than
        memory holds.
    """
    clock = clock or StageClock()
    with clock.stage("estimate"):
        view = open_view(scene, volume, photon_map.rounds, method=method, gather_count=gather_count, threads=threads)
        if cluster is None:
            scattered = view.scattered(photon_map, progress)
        else:
            file = VolumeFile(volume_path, file_hash(volume_path))
            scattered = scattered_apart(cluster, view, photon_map, file, progress)
        image = view.image(scattered, {"photon_map": dict(photon_map.provenance)})
    return image, summarize(view, image, scattered, clock)


def open_view(
    scene: Any,
    volume: SkinVolume,
    rounds: int,
    *,
    method: str | None = None,
    gather_count: int | None = None,
    threads: int | None = None,
) -> View:
    """The view of a scene's camera, if memory holds its picture of photons in so many rounds."""
    gather_count = gather_count or scene.estimate.gather_count
    with about(scene):
        view = View(scene, volume, method or scene.estimate.method, gather_count, threads)
        require_memory(
            estimate_bytes(scene, volume, view.method, rounds, threads),
            f"a picture of {' x '.join(map(str, scene.camera.pixels))} pixels in {len(volume.wavelength_nm)} bands",
            key=("camera", "pixels"), remedy="Use fewer pixels or bands.",
        )  # fmt: skip
    return view


def estimate_bytes(scene: Any, volume: SkinVolume, method: str, rounds: int, threads: int | None = None) -> int:
    """Most memory that an estimate takes beside the volume; the photon map is mapped, not held."""
    pixels, bands, threads = math.prod(scene.camera.pixels), len(volume.wavelength_nm), threads or os.cpu_count() or 1
    reflection = 0
    if why_no_reflection(scene, volume) is None:
        reflection = surface_bytes(surface_subpixels(scene, volume) ** 2 * pixels, pixels, bands)
    # scattered once, reflected and falling light, and what flat skin lets through; a growing picture has them first
    made = (3 if volume.has_relief else 4) * 8 * pixels * bands
    alone = max(reflection, 8 * pixels * bands)
    filled = volume.palette_index.nbytes if volume.has_relief else 0  # the voxels again, without air
    if method == "reference":
        return filled + made + max(reference_bytes(scene.camera, volume, pixels, bands, rounds, threads), alone)
    slabs, regions = len(depth_edges(volume, method)) - 1, regions_of(volume).count
    rays = transmittance_subpixels(volume) ** 2 * pixels
    lattices = {pixels, rays} if method == "point" else {rays}
    held = sum(paths_bytes(q, slabs, regions, bands) + lattice_bytes(q, slabs) for q in lattices)
    counts = pixels, rays, slabs, bands, rounds
    of_method = beam_bytes(*counts) if method == "beam" else point_bytes(*counts, threads)
    return filled + made + held + crossings_bytes(rays, slabs) + max(of_method, alone)


def summarize(view: View, image: SpectralImage, scattered: ScatteredLight, clock: StageClock) -> EstimateSummary:
    """What is told of a picture."""
    return EstimateSummary(
        method=view.method,
        mean_radiance=float(image.radiance.sum(axis=-1, dtype=np.float64).mean()),
        mean_radiance_stderr=float(batch_stderr(scattered.batch_radiance, scattered.batch_rounds)),
        nan_pixels=int(np.sum(~np.isfinite(image.radiance).all(axis=-1))),
        photons_gathered=float(scattered.gathered),
        stderr_relative_mean=relative_stderr(image),
        remaining=scattered.remaining,
        seconds=clock.seconds,
    )


def relative_stderr(image: SpectralImage) -> float | None:
    """Mean over the lit pixels of the standard error of luminance over the luminance; None where it is not known."""
    y = image.y()
    lit = y > 0
    ratio = image.stderr_Y[lit] / y[lit]
    return float(ratio.mean()) if ratio.size and np.isfinite(ratio).all() else None
