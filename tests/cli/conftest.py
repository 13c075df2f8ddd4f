"""A small render that the commands' tests share."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from command_line import FEW_PHOTONS, SMALL, call, summary_of


@pytest.fixture(scope="session")
def smoke_scene(repository) -> Path:
    return repository / "configs" / "smoke_beam.yaml"


@pytest.fixture(scope="session")
def first_render(smoke_scene, tmp_path_factory) -> tuple[Path, dict]:
    """Folder and summary of a small render; not to be changed."""
    folder = tmp_path_factory.mktemp("render")
    return folder, summary_of(call("render", smoke_scene, *SMALL, *FEW_PHOTONS, "-o", folder, "--json"))


@pytest.fixture
def rendered(first_render, tmp_path) -> Path:
    """A copy of the small render, to be changed."""
    return shutil.copytree(first_render[0], tmp_path / "rendered")


@pytest.fixture
def slab(tmp_path) -> Path:
    """A scene of one voxel and one band, which builds at once."""
    path = tmp_path / "slab.yaml"
    path.write_text(
        "patch: {size_mm: [1, 1], columns: [1, 1]}\n"
        "bands_nm: [550]\n"
        "slab:\n"
        "  layers:\n"
        "    - {thickness_mm: 1, mu_a_per_mm: 1, mu_s_per_mm: 5, g: 0.5, refractive_index: 1.4}\n"
        "light: {kind: collimated}\n"
        "camera: {pixels: [4, 4]}\n"
        "photons: {stored: 1e3}\n",
        encoding="utf-8",
    )
    return path
