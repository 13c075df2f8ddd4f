"""A small right scene that the tests break in one place."""

import pytest

SCENE = """\
patch: {size_mm: [4, 2], columns: [8, 4]}
bands_nm: [450, 550]
skin:
  site: forearm
light:
  kind: point
"""


@pytest.fixture
def scene_text():
    """The small scene; its last line, 6, is in the section `light`."""
    return SCENE


@pytest.fixture
def write_scene(tmp_path):
    """Function that writes a scene file and returns its path."""

    def write(text=SCENE, name="scene.yaml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write
