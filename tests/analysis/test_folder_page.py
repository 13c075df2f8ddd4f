"""The page that explains a folder."""

from __future__ import annotations

import re

import numpy as np
import pytest

from skinrender.analysis.folder_page import write_folder_page
from skinrender.engine.clock import append_timing
from skinrender.film.exr import write_exr
from skinrender.film.png import write_png
from skinrender.film.spectral_image import SpectralImage
from skinrender.scene import load_scene

SUMMARY = {"stderr_relative_mean": 0.0234, "clipped_fraction": 0.5}
PHOTONS = {"stop": {"rule": "StoredCount", "stored": 50_000_000}, "seed": 7}


@pytest.fixture
def scene(repository):
    return load_scene(repository / "configs" / "smoke_beam.yaml", ["description=a <b>macule</b>"])


def put_picture(folder, method, provenance):
    ones = np.ones((3, 4, 1), np.float32)
    parts = [ones[..., 0]] * 4
    write_exr(folder / f"{method}.exr", SpectralImage(ones, np.array([550.0]), *parts, ones, 1.0, provenance))
    write_png(folder / f"{method}.png", np.ones((3, 4, 3)))


def test_page_shows_pictures_seconds_files_and_origin(tmp_path, scene):
    put_picture(tmp_path, "beam", {"summary": SUMMARY, "photon_map": PHOTONS})
    for total in (3.0, 61.5):
        append_timing(tmp_path / "timing.csv", {"trace": 2.0, "total": total}, command="render", workers=2)
    write_folder_page(tmp_path / "index.html", scene, "skinrender render a&b.yaml")
    told = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "by the beam estimate; 5e+07 photons; seed 7; noise of a pixel 2.3 % of its luminance" in told
    assert "50 % of the pixels clipped" in told
    assert told.count("data:image/png;base64,") == 1
    assert told.count("<td class=text>render</td>") == 1 and "61.50" in told
    assert "<td class=text>beam.exr</td>" in told and "volume.npz" not in told
    assert "skinrender render a&amp;b.yaml" in told and "a &lt;b&gt;macule" in told
    assert "&quot;melanin_scale&quot;: 0.5" in told and str(scene.source_dir) in told
    assert not re.search(r"<script|https?://|src=\"(?!data:)", told)


def test_pictures_of_which_nothing_is_known_are_left_out(tmp_path, scene):
    put_picture(tmp_path, "point", {})
    put_picture(tmp_path, "reference", {})
    (tmp_path / "reference.exr").write_bytes(b"damaged")
    write_png(tmp_path / "beam.png", np.ones((3, 4, 3)))
    write_folder_page(tmp_path / "index.html", scene, "x")
    assert re.findall(r'alt="([^"]+)"', (tmp_path / "index.html").read_text(encoding="utf-8")) == ["picture by point"]


@pytest.mark.parametrize("content", [b"", b"a,b\n1,2\n", b"\xff\xfe", b"finished,command,stage,seconds,workers,cpu\n1,2,3,x,5,6\n"])
def test_a_table_of_seconds_that_is_none_is_left_out(tmp_path, scene, content):
    (tmp_path / "timing.csv").write_bytes(content)
    write_folder_page(tmp_path / "index.html", scene, "x")
    assert "<h2>Seconds" not in (tmp_path / "index.html").read_text(encoding="utf-8")
