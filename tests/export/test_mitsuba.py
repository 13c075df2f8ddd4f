"""Mitsuba scenes: their parts, and, where it is installed, their pictures against the single-scattering formula."""

from __future__ import annotations

import struct
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.export.mitsuba import write_mitsuba
from skinrender.scene.schema_camera import OrthographicCamera, PerspectiveCamera
from tests.volumes import Layer, beam, lamp, sky, slab_volume

CAMERA = OrthographicCamera(pixels=(8, 8), window_mm=(0.5, 0.5))
# little is scattered, so that nearly all of it is scattered once
FAINT = (Layer(0.2, 1.0, 0.02, 0.0, 1.0), Layer(0.3, 0.5, 0.03, 0.5, 1.0))


def written(folder, volume, light, camera=CAMERA, samples=16):
    done = write_mitsuba(volume, light, camera, 550.0, folder / "scene.xml", samples)
    return done, ET.parse(done.scene).getroot()


def test_grid_holds_extinction_with_x_fastest(tmp_path):
    volume = slab_volume(FAINT, columns=(2, 3), planes=(2, 3))
    volume.palette_index[1, 2, 0] = 2
    done, root = written(tmp_path, volume, beam())
    data = (tmp_path / "scene_sigma_t.vol").read_bytes()
    assert data[:3] == b"VOL"
    assert struct.unpack("<B5i", data[3:24]) == (3, 1, 2, 3, 5, 1)
    values = np.frombuffer(data[48:], "<f4").reshape(5, 3, 2)
    assert values[:, 0, 0] == pytest.approx([1.02, 1.02, 0.53, 0.53, 0.53])
    assert values[0, 2, 1] == pytest.approx(0.53)
    assert {path.name for path in done.grids} == {"scene_sigma_t.vol", "scene_albedo.vol", "scene_weight.vol"}
    assert root.find("medium/phase").get("type") == "blendphase"


def test_uniform_medium_needs_no_grid(tmp_path):
    done, root = written(tmp_path, slab_volume((Layer(1.0, 0.5, 2.0, 0.8, 1.0),)), sky())
    assert done.grids == ()
    assert root.find("medium").get("type") == "homogeneous"
    assert float(root.find("medium/float[@name='albedo']").get("value")) == pytest.approx(0.8)


@pytest.mark.parametrize(("n", "below", "faces"), [(1.0, 1.0, 0), (1.4, 1.4, 1), (1.4, 1.0, 2)])
def test_borders_refract_where_indices_differ(tmp_path, n, below, faces):
    _, root = written(tmp_path, slab_volume((Layer(1.0, 0.5, 2.0, 0.8, n),), below=below), sky())
    dielectric = root.findall("shape/bsdf[@type='dielectric']")
    assert len(dielectric) == faces
    if faces:
        assert {p.get("name"): float(p.get("value")) for p in dielectric[0]} == {"int_ior": n, "ext_ior": 1.0}


def test_what_is_left_out_is_told_and_stands_in_the_file(tmp_path):
    done, _ = written(tmp_path, slab_volume(FAINT, sides="periodic"), sky())
    assert any("periodic sides" in note for note in done.notes)
    assert all(note in done.scene.read_text(encoding="utf-8") for note in done.notes)


def test_lamp_behind_glass_is_a_sphere_of_the_same_intensity(tmp_path):
    _, root = written(tmp_path, slab_volume((Layer(1.0, 0.5, 2.0),)), lamp(height=10.0))
    sphere = root.find("shape[@type='sphere']")
    radius = float(sphere.find("float[@name='radius']").get("value"))
    radiance = float(sphere.find("emitter/spectrum").get("value"))
    assert np.pi * radius**2 * radiance == pytest.approx(1.0)


@pytest.mark.parametrize("light", [beam(), beam(radius=0.0)])
def test_light_that_no_path_finds_is_refused(tmp_path, light):
    with pytest.raises(InputError, match="cannot find"):
        written(tmp_path, slab_volume((Layer(1.0, 0.5, 2.0),)), light)
    assert not list(tmp_path.iterdir())


def test_oblong_pixels_are_refused(tmp_path):
    with pytest.raises(InputError, match="not square"):
        written(tmp_path, slab_volume(FAINT), sky(), OrthographicCamera(pixels=(8, 4)))


@pytest.fixture
def mitsuba():
    module = pytest.importorskip("mitsuba", reason="mitsuba is not installed (extra interop)")
    module.set_variant("scalar_rgb")
    return module


def once_scattered(layers) -> float:
    """Radiance straight back of irradiance 1 straight down, scattered once."""
    depth, radiance = 0.0, 0.0
    for layer in layers:
        mu_t = layer.mu_a + layer.mu_s
        phase = (1 - layer.g**2) / (4 * np.pi * (1 + layer.g) ** 3)
        radiance += layer.mu_s * phase * np.exp(-2 * depth) * (1 - np.exp(-2 * mu_t * layer.thickness)) / (2 * mu_t)
        depth += mu_t * layer.thickness
    return radiance


def test_mitsuba_renders_parallel_light(tmp_path, mitsuba):
    done, _ = written(tmp_path, slab_volume(FAINT), beam(), samples=1024)
    picture = np.array(mitsuba.render(mitsuba.load_file(str(done.scene))))
    assert picture.mean() == pytest.approx(once_scattered(FAINT), rel=0.02)


def test_mitsuba_looks_the_same_way(tmp_path, mitsuba):
    """Rows along y, columns along x: one column of voxels is empty, and so is its part of the picture."""
    volume = slab_volume(FAINT, columns=(2, 2))
    volume.palette_index[1, 0, :] = 0
    window = {"window_mm": (1.0, 1.0), "pixels": (8, 8)}
    for camera in (OrthographicCamera(**window), PerspectiveCamera(kind="perspective", distance_mm=100.0, **window)):
        done, _ = written(tmp_path, volume, lamp(height=10.0), camera, samples=64)
        picture = np.array(mitsuba.render(mitsuba.load_file(str(done.scene))))[..., 0]
        dark = picture < 1e-3 * picture.max()
        assert dark[:3, 5:].all()
        assert not dark[:3, :3].any()
        assert not dark[5:].any()
