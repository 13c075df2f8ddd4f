"""Single scattering (the paper's section 7: first scatterings are not in the map but computed apart).

Along the refracted view ray the source is mu_s p E with E the irradiance of the refracted pencil of the lamp. In every
interval of the ray the tissue is uniform, the logarithm of both transmittances is taken to be linear and the rest is
evaluated at the exponential's centroid: exact for parallel light, second order in the step for a point lamp.

The term covers the region down to the first border that refracts; first scatterings below it are photons.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skinrender.estimate.connection import connect, make_lamp
from skinrender.estimate.sky import sky_single_scattering
from skinrender.estimate.view_path import LEVEL, ViewPath, geometry_band
from skinrender.photonmap.first_scattering import has_single_term, is_laterally_uniform
from skinrender.photonmap.light import CollimatedLight, Light, SkyLight
from skinrender.skin.regions import regions_of
from skinrender.transport import allocating_kernel, kernel
from skinrender.transport.fresnel import fresnel
from skinrender.transport.optical_depth import add_optical_depth, first_cell, lateral_exit, plane_exit
from skinrender.transport.phase import phase_hg

_DARK = 30.0  # optical depth beyond which nothing is seen
# Steps under a point lamp, whose rays are not parallel: the first one in units of sqrt(height * shortest mean free
# path), then a share of the path so far, at most a share of the height. Together they keep the error near 1e-4.
_FIRST_STEP = 0.03
_GROWTH = 0.4
_STEP_OF_HEIGHT = 0.02


def region_bottom_mm(volume: Any) -> float:
    """Depth of the first border below the surface that refracts, or of the volume's bottom."""
    return float(min([*(volume.border_z_mm[k + 1] for k in volume.fresnel_borders), volume.z_edges_mm[-1]]))


def single_scattering(view: ViewPath, volume: Any, light: Light) -> np.ndarray:
    """Radiance outside of light that scattered once, (Q, B) W/mm2/sr in the band.

    Zero when `has_single_term` is false.
    """
    if not has_single_term(volume, light):
        return np.zeros_like(view.transmission)
    eta = np.ascontiguousarray(volume.n_outside / regions_of(volume).index[1])
    mu_t = np.ascontiguousarray(volume.mu_a + volume.mu_s)
    z_end = region_bottom_mm(volume)
    if isinstance(light, SkyLight):
        column = np.asarray(volume.palette_index[0, 0])
        inside = sky_single_scattering(
            view.cos_inside, column, volume.z_edges_mm, z_end, mu_t, volume.mu_s, volume.g, eta
        )
        return np.where(view.hit[:, None], light.radiance * inside * view.transmission, 0.0)
    uniform = is_laterally_uniform(volume.palette_index)
    palette, z_edges = merge_planes(
        volume.palette_index[:1, :1] if uniform else volume.palette_index, volume.z_edges_mm
    )
    longest_step = np.full(len(mu_t), np.inf) if uniform else _steps_across_columns(volume, mu_t)
    lamp = make_lamp(light, float(eta[geometry_band(volume.wavelength_nm)]))
    inside = _scatter_once(
        view.hit & (view.cos_inside > LEVEL), view.entry, view.direction, lamp, eta, geometry_band(volume.wavelength_nm), palette,
        z_edges, *map(float, volume.size_mm), z_end, volume.sides == "periodic", mu_t, volume.mu_s, volume.g,
        longest_step,
    )  # fmt: skip
    power = light.irradiance if isinstance(light, CollimatedLight) else light.intensity
    return power * inside * view.transmission


def merge_planes(palette_index: np.ndarray, z_edges_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same volume in as few planes as hold it: the passages then cross fewer voxels."""
    changes = (palette_index[:, :, 1:] != palette_index[:, :, :-1]).any(axis=(0, 1))
    first = np.concatenate([[0], np.flatnonzero(changes) + 1])
    return np.ascontiguousarray(palette_index[:, :, first]), np.append(z_edges_mm[first], z_edges_mm[-1])


def _steps_across_columns(volume: Any, mu_t: np.ndarray) -> np.ndarray:
    """Longest step in each palette entry, (P,) mm, while the pencil's entry moves aside by its depth.

    The pencil crosses columns at other depths than the view ray does, so its optical depth bends within a voxel.
    """
    width = min(volume.size_mm[0] / volume.shape[0], volume.size_mm[1] / volume.shape[1])
    return np.clip(0.5 / np.maximum(mu_t.max(axis=1), 1e-12), 0.1 * width, 0.5 * width)


@allocating_kernel
def _scatter_once(
    hit, entry, direction, lamp, eta, band, palette, z_edges, lx, ly, z_end, periodic, mu_t, mu_s, g, longest_step,
):  # fmt: skip
    """Radiance under the surface per unit of the lamp's strength, (Q, B)."""
    result = np.zeros((hit.size, eta.size))
    work = np.zeros((5, eta.size))
    first_step = _FIRST_STEP * math.sqrt(lamp.height / max(mu_t.max(), 1e-12))
    visible = _DARK / max(mu_t[1:].min(), 1e-12)
    for q in range(hit.size):
        if not hit[q]:
            continue
        x, y = entry[q, 0], entry[q, 1]
        dx, dy, dz = direction[q]
        length = min(visible, _length_inside(x, y, dx, dy, dz, lx, ly, z_end, periodic))
        tiles = _tiles(x, y, dx, dy, length, lx, ly, periodic and lamp.is_point)
        for tile_x in range(tiles[0], tiles[1] + 1):
            for tile_y in range(tiles[2], tiles[3] + 1):
                if _may_light(lamp, tile_x, tile_y, lx, ly, eta[band], x, y, dx, dy, dz, length):
                    _march(
                        result[q], work, lamp, tile_x, tile_y, eta, band, palette, z_edges, lx, ly, periodic,
                        mu_t, mu_s, g, longest_step, first_step, x, y, dx, dy, dz, length,
                    )  # fmt: skip
    return result


@kernel
def _length_inside(x, y, dx, dy, dz, lx, ly, z_end, periodic):
    """Length of the view ray down to z_end, or to the side of a patch that is not periodic."""
    length = z_end / dz
    if not periodic:
        length = min(length, ((lx if dx > 0.0 else 0.0) - x) / dx if dx != 0.0 else np.inf)
        length = min(length, ((ly if dy > 0.0 else 0.0) - y) / dy if dy != 0.0 else np.inf)
    return max(length, 0.0)


@kernel
def _tiles(x, y, dx, dy, length, lx, ly, periodic):
    """First and last tile in x and y whose lamps may reach the view ray: its own and the neighbors."""
    if not periodic:
        return 0, 0, 0, 0
    end_x, end_y = x + dx * length, y + dy * length
    return (
        math.floor(min(x, end_x) / lx) - 1, math.floor(max(x, end_x) / lx) + 1,
        math.floor(min(y, end_y) / ly) - 1, math.floor(max(y, end_y) / ly) + 1,
    )  # fmt: skip


@kernel
def _may_light(lamp, tile_x, tile_y, lx, ly, eta, x, y, dx, dy, dz, length):
    """Whether passages of a tile's point lamp to the view ray can enter in its tile.

    A denser medium bends a passage towards the normal, so it enters between the straight line's entry and the point's
    own foot: a bounding box of both, at both ends of the ray, is compared with the tile.
    """
    if not lamp.is_point or eta > 1.0:
        return True
    end_x, end_y = x + dx * length, y + dy * length
    share = dz * length / (lamp.height + dz * length)
    straight_x = end_x + (lamp.x + tile_x * lx - end_x) * share
    straight_y = end_y + (lamp.y + tile_y * ly - end_y) * share
    below_x = max(x, max(end_x, straight_x)) < tile_x * lx
    below_y = max(y, max(end_y, straight_y)) < tile_y * ly
    above_x = min(x, min(end_x, straight_x)) > (tile_x + 1) * lx
    above_y = min(y, min(end_y, straight_y)) > (tile_y + 1) * ly
    return not (below_x or below_y or above_x or above_y)


@allocating_kernel
def _march(
    row, work, lamp, tile_x, tile_y, eta, band, palette, z_edges, lx, ly, periodic,
    mu_t, mu_s, g, longest_step, first_step, x, y, dx, dy, dz, length,
):  # fmt: skip
    """Add one lamp's light along a view ray from (x, y, 0), voxel by voxel, to row (B,)."""
    nx, ny, _ = palette.shape
    gx, gy, vx, vy = x * (nx / lx), y * (ny / ly), dx * (nx / lx), dy * (ny / ly)
    cx, cy, k = first_cell(gx, vx), first_cell(gy, vy), 0
    depth, tau_a, tau_b, light_a, light_b = work[0], work[1], work[2], work[3], work[4]
    depth[:] = 0.0
    cos_a, drift = _light_at(
        light_a, tau_a, lamp, tile_x, tile_y, eta, band, palette, z_edges, lx, ly, periodic, mu_t, x, y, 0.0, dx, dy, dz
    )
    s = 0.0
    while s < length:
        exit_x, exit_y, exit_z = lateral_exit(gx, vx, cx), lateral_exit(gy, vy, cy), plane_exit(z_edges, 0.0, dz, k)
        voxel_end = max(s, min(min(exit_x, exit_y), min(exit_z, length)))
        entry = palette[cx % nx, cy % ny, k]
        while s < voxel_end:
            ds = min(voxel_end - s, longest_step[entry] / max(drift, 1e-3))
            if lamp.is_point:
                ds = min(ds, min(max(first_step, _GROWTH * s), _STEP_OF_HEIGHT * (lamp.height + dz * s)))
            end = s + ds if ds < voxel_end - s else voxel_end
            cos_b, drift = _light_at(
                light_b, tau_b, lamp, tile_x, tile_y, eta, band, palette, z_edges, lx, ly, periodic, mu_t,
                x + dx * end, y + dy * end, dz * end, dx, dy, dz,
            )  # fmt: skip
            is_seen = _add_interval(
                row, end - s, depth, tau_a, tau_b, light_a, light_b, cos_a, cos_b, mu_t[entry], mu_s[entry], g[entry]
            )
            if not is_seen:
                return
            tau_a[:], light_a[:], cos_a = tau_b, light_b, cos_b
            s = end
        if exit_z <= exit_x and exit_z <= exit_y:
            k += 1
        elif exit_x <= exit_y:
            cx += 1 if vx > 0.0 else -1
        else:
            cy += 1 if vy > 0.0 else -1


@kernel
def _light_at(
    light, tau, lamp, tile_x, tile_y, eta, band, palette, z_edges, lx, ly, periodic, mu_t,
    x, y, z, view_x, view_y, view_z,
):  # fmt: skip
    """The pencil at a point of the view ray: writes its strength after Fresnel (B,) and its optical depth (B,).

    Returns the cosine of the turn, and how far the pencil's entry moves aside per unit of the view ray's depth.
    """
    strength, entry_x, entry_y, dx, dy, dz, length, cos_outside = connect(
        lamp, tile_x, tile_y, lx, ly, periodic, eta[band], x, y, z
    )
    tau[:] = 0.0
    if strength > 0.0:
        add_optical_depth(palette, z_edges, lx, ly, mu_t, entry_x, entry_y, 0.0, dx, dy, dz, length, tau)
    before, passed = -1.0, 0.0
    for b in range(eta.size):
        if eta[b] != before:
            before, passed = eta[b], strength * (1.0 - fresnel(cos_outside, eta[b])[0])
        light[b] = passed
    drift = math.hypot(view_x / view_z - dx / dz, view_y / view_z - dy / dz)
    return -(dx * view_x + dy * view_y + dz * view_z), drift


@kernel
def _add_interval(row, ds, depth, tau_a, tau_b, light_a, light_b, cos_a, cos_b, mu_t, mu_s, g):
    """Add the scattering of an interval of uniform tissue to row (B,), its extinction to depth (B,).

    Returns False when all bands are dark beyond it.
    """
    is_seen = False
    for b in range(row.size):
        before, step = depth[b], mu_t[b] * ds
        depth[b] = before + step
        is_seen = is_seen or depth[b] < _DARK
        if (light_a[b] <= 0.0 and light_b[b] <= 0.0) or mu_s[b] <= 0.0:
            continue
        if light_a[b] > 0.0 and light_b[b] > 0.0:
            start, rise = before + tau_a[b], step + tau_b[b] - tau_a[b]
        else:
            # the edge of a tile or a beam lies within: the lit end's optical depth stands for both
            start, rise = before + max(tau_a[b], tau_b[b]), step
        if start > _DARK:
            continue
        if abs(rise) > 1e-3:
            weight = -math.expm1(-rise) / rise
            centroid = 1.0 / rise - math.exp(-rise) / -math.expm1(-rise)
        else:
            weight, centroid = 1.0 - 0.5 * rise + rise * rise / 6.0, 0.5 - rise / 12.0
        light = light_a[b] + centroid * (light_b[b] - light_a[b])
        phase = phase_hg(cos_a + centroid * (cos_b - cos_a), g[b])
        row[b] += ds * math.exp(-start) * weight * mu_s[b] * phase * light
    return is_seen
