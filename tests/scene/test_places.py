"""Mistakes that show after a scene was checked name file, line and column too."""

import numpy as np
import pytest
from skimage.io import imsave

import skinrender
from skinrender.errors import InputError, SceneError
from skinrender.scene import about, load_scene

SCENE = """\
patch: {size_mm: [1, 1], columns: [8, 8]}
bands_nm: [550]
skin:
  site: forearm
  border_wave: {peak_to_valley_um: 0}
relief: {kind: flat}
"""
LESION = "lesions:\n  - kind: epidermal\n    pattern: p.png\n  - pattern: p.png\n    "
CASES = {
    f"{LESION}kind: dermal\n    half_layers: 1\n    center_layer: 99": "s.yaml:13:5: lesions.1.center_layer: center_layer 99",
    f"{LESION}kind: mole\n    depth_mm: 9": "s.yaml:12:5: lesions.1.depth_mm: depth_mm 9 lies below the dermis\n  Use at most",
    f"{LESION}kind: mole\n    depth_layers: 99": "s.yaml:12:5: lesions.1.depth_layers: 99 voxel layers",
    f"{LESION}kind: tattoo\n    volume_fraction: 0.1\n    ink: ink.csv\n    depth_mm: [0, 1]": "s.yaml:13:5: lesions.1.ink: ",
    "lesions: [{kind: epidermal, pattern: small.png}]": "s.yaml:7:29: lesions.0.pattern: ",
    "light: {kind: sky, spectrum: ink.csv}": "s.yaml:7:20: light.spectrum: ",
}


@pytest.fixture
def folder(tmp_path):
    imsave(tmp_path / "p.png", np.zeros((8, 8), np.uint8), check_contrast=False)
    imsave(tmp_path / "small.png", np.zeros((4, 4), np.uint8), check_contrast=False)
    (tmp_path / "ink.csv").write_text("400,1\n500,2\n")
    return tmp_path


@pytest.mark.parametrize("part", CASES)
def test_what_a_build_or_a_light_refuses_names_the_place(folder, part):
    (folder / "s.yaml").write_text(SCENE + part)
    scene = load_scene(folder / "s.yaml")
    with pytest.raises(InputError) as caught:
        skinrender.trace(scene, _saved(scene, folder), folder)
    assert str(caught.value).startswith(f"{folder}/{CASES[part]}")


def _saved(scene, folder):
    skinrender.save_volume(skinrender.build(scene), folder / "volume.npz")
    return folder / "volume.npz"


def test_an_override_is_the_place_of_its_value(folder):
    (folder / "s.yaml").write_text(SCENE)
    scene = load_scene(folder / "s.yaml", ["relief={kind: procedural, families: [{spacing_mm: 9, depth_um: 9, width_um: 9, angle_deg: 0}]}"])
    with pytest.raises(InputError, match=r"^--set relief=.*: relief\.families: furrows 9 mm apart do not fit"):
        skinrender.build(scene)


def test_a_scene_without_a_file_names_the_key_alone():
    scene = skinrender.make_scene({"patch": {"size_mm": [1, 1], "columns": [1, 1]}, "skin": {}})
    with pytest.raises(SceneError, match=r"^light\.spectrum: wrong\n  mend it"), about(scene, "light"):
        raise SceneError("wrong", key=("spectrum",), remedy="mend it")
