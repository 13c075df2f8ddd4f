"""The estimate stage: photon map and volume in, spectral picture out (paper, section 7.2).

Radiance of a pixel = light reflected by the surface + single scattering + multiple scattering (beam or point).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tqdm import tqdm

from skinrender.engine.clock import StageClock
from skinrender.errors import InputError
from skinrender.estimate.beam import estimate_beam
from skinrender.estimate.lattice import RayLattice, make_lattice
from skinrender.estimate.point import estimate_point, march_edges
from skinrender.estimate.ray_paths import follow_rays, slab_edges, visible_depth_mm
from skinrender.estimate.scatter_image import ScatteredLight, batch_stderr
from skinrender.estimate.single import single_scattering
from skinrender.estimate.stream import Stream
from skinrender.estimate.surface import irradiance, surface_reflection
from skinrender.estimate.view_path import make_view_path
from skinrender.film.camera import view_rays
from skinrender.film.color import exposure_for, y_weights
from skinrender.film.spectral_image import SpectralImage
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_map import PhotonMap
from skinrender.skin.volume import SkinVolume

RELIEF_SUBPIXELS = 2
TRANSMITTANCE_SUBPIXELS = 2
METHODS = ("beam", "point")


@dataclass(frozen=True, eq=False)
class EstimateSummary:
    """What the `estimate` command reports.

    Parameters
    ----------
    mean_radiance, mean_radiance_stderr : over all pixels, summed over bands, W mm^-2 sr^-1.
    nan_pixels : pixels with a value that is not finite.
    photons_gathered : photons met by a beam or a sample point, on average.
    stderr_relative_mean : mean over the lit pixels of the standard error of luminance over the luminance.
    seconds : by stage.
    """

    method: str
    mean_radiance: float
    mean_radiance_stderr: float
    nan_pixels: int
    photons_gathered: float
    stderr_relative_mean: float | None
    seconds: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """The object that ``skinrender estimate --json`` prints."""
        stderr = self.mean_radiance_stderr
        return {
            "method": self.method,
            "mean_radiance": {"value": self.mean_radiance, "stderr": stderr if np.isfinite(stderr) else None},
            "nan_pixels": self.nan_pixels,
            "photons_gathered_mean": self.photons_gathered,
            "stderr_relative_mean": self.stderr_relative_mean,
            "seconds": dict(self.seconds),
        }


def estimate(
    scene: Any,
    volume: SkinVolume,
    photon_map: PhotonMap,
    *,
    method: str | None = None,
    gather_count: int | None = None,
    threads: int | None = None,
    progress: bool = True,
    clock: StageClock | None = None,
) -> tuple[SpectralImage, EstimateSummary]:
    """Estimate the picture of a scene from its photon map.

    Parameters
    ----------
    scene : its camera, light, finish and estimate sections are read.
    method, gather_count : other than the scene's.
    threads : of the estimate; all cores by default.
    progress : show a bar when on a terminal.
    clock : receives the seconds of the stage ``estimate``.

    Raises
    ------
    InputError : a method that does not exist, or borders that a view ray cannot be followed through.
    """
    method = method or scene.estimate.method
    if method not in METHODS:
        raise InputError(f"got {method!r}; allowed: {', '.join(METHODS)}", where="--method")
    if volume.fresnel_borders and (volume.border_mm is not None or volume.surface_mm is not None):
        raise InputError(
            "pictures need flat borders where inner borders refract", where="inner_borders",
            remedy="use `inner_borders: matched`, or a flat relief and no border wave",
        )  # fmt: skip
    clock = clock or StageClock()
    with clock.stage("estimate"):
        light = light_from_scene(scene)
        subpixels = scene.estimate.subpixels or (1 if volume.surface_mm is None else RELIEF_SUBPIXELS)
        edges = slab_edges(volume) if method == "beam" else march_edges(visible_depth_mm(volume))
        rays = view_rays(scene.camera, volume.size_mm)
        pixels = _lattice(rays, volume, edges)
        lattice = pixels
        if volume.surface_mm is not None:
            lattice = _lattice(view_rays(scene.camera, volume.size_mm, TRANSMITTANCE_SUBPIXELS), volume, edges)
        center = irradiance(light, np.array([0.5 * length for length in volume.size_mm]), volume.size_mm, True)
        if not center.any():  # a pencil, or a beam beside the center: exposed for its mean over the patch
            center = light.power_aimed_per_band(volume.size_mm) / np.prod(volume.size_mm)
        exposure = exposure_for(center, volume.wavelength_nm)
        y_weight = y_weights(volume.wavelength_nm, exposure)
        gather = gather_count or scene.estimate.gather_count
        scattered = _scattered(volume, photon_map, (lattice, pixels), y_weight, method, gather, threads, progress)
        view = make_view_path(rays.origin, rays.direction, volume)
        single = single_scattering(view, volume, light)
        surface = _surface(scene, volume, light, subpixels)
        points = view.entry[:, :2] if view.hit.all() else _plane_points(rays)
        falling = irradiance(light, points, volume.size_mm, volume.sides == "periodic")
        image = _image(pixels.shape, scattered, single, surface, falling, y_weight, exposure, volume, photon_map)
    return image, _summary(method, image, scattered, clock)


def _scattered(volume, photon_map, lattices, y_weight, method, gather, threads, progress) -> ScatteredLight:
    count = threads or os.cpu_count() or 1
    bar = tqdm(
        total=len(photon_map), unit=" photons", unit_scale=True, disable=None if progress else True, desc=method, leave=False
    )
    with ThreadPoolExecutor(count) as pool, bar:
        stream = Stream(volume, photon_map, *lattices, y_weight, pool, count, bar.update)
        return (estimate_beam if method == "beam" else estimate_point)(stream, gather)


def _lattice(rays: Any, volume: SkinVolume, edges: np.ndarray) -> RayLattice:
    return make_lattice(follow_rays(rays.origin, rays.direction, volume, edges), rays.origin.shape[:2])


def _surface(scene: Any, volume: SkinVolume, light: Any, subpixels: int) -> np.ndarray:
    """Light reflected by the surface, mean over the subpixels of each pixel, (h w, B).

    Only this term needs more than one ray a pixel: facets of a relief are smaller than pixels, while the light from
    inside is smooth.
    """
    w, h = scene.camera.pixels
    bands = len(volume.wavelength_nm)
    if scene.camera.cross_polarized:
        return np.zeros((h * w, bands))
    rays = view_rays(scene.camera, volume.size_mm, subpixels)
    view = make_view_path(rays.origin, rays.direction, volume)
    reflected = surface_reflection(view, volume, light, scene.finish)
    return reflected.reshape(h, subpixels, w, subpixels, bands).mean(axis=(1, 3)).reshape(h * w, bands)


def _plane_points(rays: Any) -> np.ndarray:
    """Where view rays meet the mean plane, (Q, 2); level ones stay where they start."""
    origin, direction = rays.origin.reshape(-1, 3), rays.direction.reshape(-1, 3)
    down = np.maximum(direction[:, 2:], 1e-6)
    return (origin + direction * (-origin[:, 2:] / down))[:, :2]


def _image(
    shape, scattered: ScatteredLight, single, surface, falling, y_weight, exposure, volume, photon_map
) -> SpectralImage:
    """The spectral picture; single, surface and falling are (h w, B)."""
    cube = (*shape, -1)
    return SpectralImage(
        radiance=(scattered.radiance + (single + surface).reshape(cube)).astype(np.float32),
        wavelength_nm=volume.wavelength_nm,
        surface_Y=(surface @ y_weight).reshape(shape).astype(np.float32),
        single_Y=(single @ y_weight).reshape(shape).astype(np.float32),
        multiple_Y=(scattered.radiance @ y_weight).astype(np.float32),
        stderr_Y=batch_stderr(scattered.batch_y, scattered.batch_rounds).astype(np.float32),
        irradiance=falling.reshape(cube).astype(np.float32),
        exposure=exposure,
        provenance={"photon_map": dict(photon_map.provenance)},
    )


def _summary(method: str, image: SpectralImage, scattered: ScatteredLight, clock: StageClock) -> EstimateSummary:
    y = image.y()
    lit = y > 0
    ratio = image.stderr_Y[lit] / y[lit]
    return EstimateSummary(
        method=method,
        mean_radiance=float(image.radiance.sum(axis=-1, dtype=np.float64).mean()),
        mean_radiance_stderr=float(batch_stderr(scattered.batch_radiance, scattered.batch_rounds)),
        nan_pixels=int(np.sum(~np.isfinite(image.radiance).all(axis=-1))),
        photons_gathered=float(scattered.gathered),
        stderr_relative_mean=float(ratio.mean()) if ratio.size and np.isfinite(ratio).all() else None,
        seconds=clock.seconds,
    )
