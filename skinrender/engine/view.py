"""What a camera sees of a volume: all of a picture that does not depend on how many photons there are.

Radiance of a pixel = light reflected by the surface + single scattering + multiple scattering (beam, point, reference).
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from tqdm import tqdm

from skinrender.errors import InputError, SceneError
from skinrender.estimate.beam import estimate_beam
from skinrender.estimate.guide import Guides
from skinrender.estimate.lattice import RayLattice, fit_plane, make_lattice
from skinrender.estimate.pixel_rays import PixelRays, pixels_of_rays
from skinrender.estimate.point import estimate_point, march_edges
from skinrender.estimate.ray_paths import follow_rays, slab_edges, visible_depth_mm
from skinrender.estimate.reference import Reference, estimate_reference, remaining_bias
from skinrender.estimate.scatter_image import BandsLight, ScatteredLight, batch_stderr, joined
from skinrender.estimate.scene_guides import scene_guides
from skinrender.estimate.single import single_scattering
from skinrender.estimate.stream import DepthSample, Stream, sample_depths
from skinrender.estimate.surface import irradiance, surface_reflection
from skinrender.estimate.transmittance import Crossings, cross_voxels
from skinrender.estimate.view_path import LEVEL, ViewPath, make_view_path, meet_surface
from skinrender.film.camera import ViewRays, view_rays
from skinrender.film.color import exposure_for, y_weights
from skinrender.film.spectral_image import SpectralImage
from skinrender.photonmap.first_scattering import has_single_term
from skinrender.photonmap.light import Light, light_from_scene
from skinrender.photonmap.photon_map import PhotonMap
from skinrender.scene import about
from skinrender.skin.regions import regions_of
from skinrender.skin.volume import SkinVolume

RELIEF_SUBPIXELS = 2
TRANSMITTANCE_SUBPIXELS = 2
METHODS = ("beam", "point", "reference")
IRRADIANCE_W_PER_MM2 = (1e-31, 1e31)


@dataclass(frozen=True, eq=False)
class View:
    """A scene's camera before its volume.

    Parameters
    ----------
    scene : its camera, light and finish are read.
    method : one of `METHODS`.
    gather_count : photons that a beam or a sample point meets; None: as many as the tissue allows.
    threads : None: all cores.

    Raises
    ------
    InputError : a method that does not exist, borders that a view ray cannot be followed through, or light too weak or
        too strong for the numbers of a picture.
    """

    scene: Any
    volume: SkinVolume
    method: str
    gather_count: int | None = None
    threads: int | None = None

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"got {self.method!r}; allowed: {', '.join(METHODS)}", where="--method")
        if why := why_no_picture(self.volume):
            raise SceneError(
                f"there is no picture: {why}", key=("inner_borders",),
                remedy="use `inner_borders: matched`, or a flat relief and no border wave",
            )  # fmt: skip

    def prepare(self) -> None:
        """Make all of the picture that needs no photons, which can be done while they are walked."""
        self.prepare_for_photons()
        for part in ("single", "surface", "falling"):
            getattr(self, part)

    def prepare_for_photons(self) -> None:
        """Make what photons are looked at with."""
        parts = {"beam": "lattice crossings guides", "point": "lattice crossings pixel_lattice", "reference": ""}
        for part in parts[self.method].split():
            getattr(self, part)

    def scattered(self, photon_map: PhotonMap, progress: bool = True) -> ScatteredLight:
        """The multiply scattered light that photons show."""
        with photons_bar(len(photon_map), self.method, progress) as bar:
            bands = np.arange(photon_map.bands)
            return self.joined([self.of_bands(photon_map, sample_depths(photon_map), bands, bar.update)], photon_map.rounds)

    def of_bands(
        self, photon_map: PhotonMap, depths: DepthSample, bands: np.ndarray, progress: Callable[[int], None]
    ) -> BandsLight:
        """The multiply scattered light that the photons of some bands (n,) show.

        photon_map needs to hold no others; depths: of the whole map, see `sample_depths`.
        """
        count = self.threads or os.cpu_count() or 1
        with ThreadPoolExecutor(count) as pool:
            if self.method == "reference":
                reference = Reference(self.scene.camera, self.volume, photon_map, self.y_weight, pool, progress)
                return estimate_reference(reference, bands)
            pixels = self.volume, self.lattice, self._shape
            stream = Stream(*pixels, self.crossings, photon_map, depths, self.y_weight, pool, progress)
            if self.method == "point":
                return estimate_point(stream, self.pixel_lattice, self.gather_count, bands)
            return estimate_beam(stream, self.gather_count, bands, self.guides)

    def joined(self, parts: Sequence[BandsLight], rounds: int) -> ScatteredLight:
        """The light of all bands, from their parts in order."""
        light = joined(parts, rounds, self.y_weight)
        if self.method != "reference":
            return light
        return replace(light, remaining=remaining_bias(self.scene.camera, self.volume, parts, light.radiance))

    def image(self, scattered: ScatteredLight, provenance: dict[str, Any]) -> SpectralImage:
        """The spectral picture."""
        shape = self.rays.origin.shape[:2]
        cube = (*shape, -1)
        return SpectralImage(
            radiance=(scattered.radiance + (self.single + self.surface).reshape(cube)).astype(np.float32),
            wavelength_nm=self.volume.wavelength_nm,
            surface_Y=(self.surface @ self.y_weight).reshape(shape).astype(np.float32),
            single_Y=(self.single @ self.y_weight).reshape(shape).astype(np.float32),
            multiple_Y=(scattered.radiance @ self.y_weight).astype(np.float32),
            stderr_Y=batch_stderr(scattered.batch_y, scattered.batch_rounds).astype(np.float32),
            irradiance=self.falling.reshape(cube).astype(np.float32),
            exposure=self.exposure,
            provenance=provenance,
        )

    @cached_property
    def light(self) -> Light:
        """The scene's lamp."""
        return light_from_scene(self.scene)

    @cached_property
    def rays(self) -> ViewRays:
        """One view ray a pixel."""
        return view_rays(self.scene.camera, self.volume.size_mm)

    @cached_property
    def path(self) -> ViewPath:
        """These rays in the skin; not needed under a relief, where light is not scattered once apart from the photons."""
        return make_view_path(self.rays.origin, self.rays.direction, self.volume)

    @property
    def _shape(self) -> tuple[int, int]:
        """(h, w) of the picture."""
        return self.rays.origin.shape[:2]

    @cached_property
    def lattice(self) -> RayLattice:
        """The lattice to which photons are connected, see `pixel_rays.PixelRays`."""
        return self._lattice(transmittance_subpixels(self.volume))

    @cached_property
    def crossings(self) -> Crossings:
        """The tissue that the lattice's rays meet."""
        return cross_voxels(self.lattice.rays, self.volume, self.threads or os.cpu_count() or 1)

    @cached_property
    def pixel_lattice(self) -> RayLattice:
        """The lattice of one ray a pixel; where the surface is flat it is `lattice`."""
        return self.lattice if self.lattice.shape == self._shape else self._lattice(1)

    @cached_property
    def guides(self) -> Guides | None:
        """The guides of the light's pattern, see `estimate.guide`; None where there is none."""
        return scene_guides(PixelRays(self.volume, self.lattice, self._shape), self.light)

    def _lattice(self, subpixels: int) -> RayLattice:
        camera, volume = self.scene.camera, self.volume
        least_cosine = 1.0 if volume.has_relief else _least_cosine(self.path)
        edges = depth_edges(volume, self.method, least_cosine)
        rays = view_rays(camera, volume.size_mm, subpixels)
        shape = rays.origin.shape[:2]
        paths = follow_rays(rays.origin, rays.direction, volume, edges)
        return make_lattice(paths, shape, picture_plane(camera, volume, shape))

    @cached_property
    def exposure(self) -> float:
        """At which a perfect diffuser in the patch's center has Y = 1."""
        size = self.volume.size_mm
        center = irradiance(self.light, np.array([0.5 * length for length in size]), size, True)
        if not center.any():  # a pencil, or a beam beside the center: exposed for its mean over the patch
            center = self.light.power_aimed_per_band(size) / np.prod(size)
        with about(self.scene):
            _check_range(float(center.sum()))
        return exposure_for(center, self.volume.wavelength_nm)

    @cached_property
    def y_weight(self) -> np.ndarray:
        """(B,) luminance of one W mm^-2 sr^-1 in each band."""
        return y_weights(self.volume.wavelength_nm, self.exposure)

    @cached_property
    def single(self) -> np.ndarray:
        """Light scattered once, (h w, B)."""
        if not has_single_term(self.volume, self.light):
            return np.zeros((math.prod(self._shape), len(self.volume.wavelength_nm)))
        return single_scattering(self.path, self.volume, self.light)

    @cached_property
    def falling(self) -> np.ndarray:
        """Irradiance of the mean plane under the pixels, (h w, B)."""
        met = meet_surface(self.rays.origin, self.rays.direction, self.volume)
        points = met.entry[:, :2] if met.hit.all() else _plane_points(self.rays)
        return irradiance(self.light, points, self.volume.size_mm, self.volume.sides == "periodic")

    @cached_property
    def surface(self) -> np.ndarray:
        """Light reflected by the surface, mean over the subpixels of each pixel, (h w, B).

        Only this term needs more than one ray a pixel: facets of a relief are smaller than pixels, while the light from
        inside is smooth.
        """
        w, h = self.scene.camera.pixels
        bands = len(self.volume.wavelength_nm)
        if why_no_reflection(self.scene, self.volume) is not None:
            return np.zeros((h * w, bands))
        subpixels = surface_subpixels(self.scene, self.volume)
        rays = view_rays(self.scene.camera, self.volume.size_mm, subpixels)
        met = meet_surface(rays.origin, rays.direction, self.volume)
        return surface_reflection(met, pixels_of_rays((h, w), subpixels), self.volume, self.light, self.scene.finish)


def photons_bar(photons: int, method: str, progress: bool) -> tqdm:
    """A bar of the photons looked at, on a terminal."""
    return tqdm(
        total=photons, unit=" photons", unit_scale=True, disable=None if progress else True, desc=method, leave=False
    )  # fmt: skip


def why_no_picture(volume: SkinVolume) -> str | None:
    """Why view rays cannot be followed through a volume; None where they can."""
    refracts = volume.fresnel_borders and not volume.is_flat
    return "inner borders refract, and they or the surface are not flat" if refracts else None


def why_no_reflection(scene: Any, volume: SkinVolume) -> str | None:
    """Why the surface's reflection is not in the picture; None where it is."""
    if scene.camera.cross_polarized:
        return "the camera is cross-polarized"
    return None if regions_of(volume).surface_refracts else "the index is the same on both sides of the surface"


def surface_subpixels(scene: Any, volume: SkinVolume) -> int:
    """Rays along each side of a pixel for the surface's reflection."""
    return scene.estimate.subpixels or (RELIEF_SUBPIXELS if volume.has_relief else 1)


def transmittance_subpixels(volume: SkinVolume) -> int:
    """Rays along each side of a pixel for the light from inside (see `pixel_rays.PixelRays`)."""
    return TRANSMITTANCE_SUBPIXELS if volume.has_relief else 1


def depth_edges(volume: SkinVolume, method: str, least_cosine: float = 1.0) -> np.ndarray:
    """Edges of the depth slabs of a beam or point estimate whose view rays have at least this cosine inside."""
    if method == "beam":
        return slab_edges(volume, least_cosine)
    return march_edges(visible_depth_mm(volume), min(volume.size_mm))


def picture_plane(camera: Any, volume: SkinVolume, shape: tuple[int, int]) -> np.ndarray:
    """Affine map (2, 3) from (x, y) on the mean plane to fractional (row, column) of an (h, w) picture of the camera."""
    quarters = view_rays(camera.model_copy(update={"pixels": (2, 2)}), volume.size_mm)
    cell = (np.argwhere(np.ones((2, 2))) + 0.5) * (np.array(shape) / 2) - 0.5
    return fit_plane(_plane_points(quarters), cell)


def _least_cosine(path: ViewPath) -> float:
    """Of the view rays that enter a flat surface."""
    return float(path.cos_inside[path.hit & (path.cos_inside > LEVEL)].min(initial=1.0))


def _check_range(irradiance: float) -> None:
    """A picture is float32: radiance near its limits would become infinite or 0."""
    low, high = IRRADIANCE_W_PER_MM2
    if not low <= irradiance <= high:
        raise SceneError(
            f"its irradiance on the patch is {irradiance:.3g} W/mm2; pictures hold {low:g} to {high:g}", key=("light",),
            remedy="change its power or its distance",
        )  # fmt: skip


def _plane_points(rays: ViewRays) -> np.ndarray:
    """Where view rays meet the mean plane, (Q, 2); level ones stay where they start."""
    origin, direction = rays.origin.reshape(-1, 3), rays.direction.reshape(-1, 3)
    down = np.maximum(direction[:, 2:], 1e-6)
    return (origin + direction * (-origin[:, 2:] / down))[:, :2]
