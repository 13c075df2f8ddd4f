from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

import skinrender
from skinrender.analysis.measured_table import compared, write_deviations, write_table
from skinrender.scene import make_scene


@pytest.fixture(scope="module")
def tan():
    scene = make_scene(
        {"name": "tan", "patch": {"size_mm": [4, 4], "columns": [1, 1]}, "bands_nm": [400, 500, 600, 700, 780],
         "skin": {"tone": "tan", "border_wave": {"peak_to_valley_um": 0}}, "relief": {"kind": "flat"}}
    )  # fmt: skip
    return skinrender.spectrum(scene, stderr=0.05, workers=1)


def with_reflectance(found, total):
    return replace(found, patch=replace(found.patch, total=total))


def test_the_mean_itself_does_not_deviate(tan):
    mean, sd = tan.measured.on_bands(tan.wavelength_nm)
    same = compared(with_reflectance(tan, mean))
    assert not same.deviation.any() and same.delta_e == 0.0 and same.outside_nm.size == 0
    off = compared(with_reflectance(tan, mean + [0.5, -1.2, 0.0, 3.0, 0.0] * sd))
    assert off.deviation == pytest.approx([0.5, -1.2, 0.0, 3.0, 0.0])
    assert off.largest_deviation == pytest.approx(1.2)
    assert off.outside_nm.tolist() == [700.0]


def test_tables_name_what_is_compared(tan, tmp_path):
    one = compared(tan)
    write_table([one], tmp_path / "table.md")
    write_deviations([one], tmp_path / "table.csv")
    assert "| tan | tan forearms |" in (tmp_path / "table.md").read_text(encoding="utf-8")
    with open(tmp_path / "table.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["deviation_sd"]) for row in rows] == pytest.approx(one.deviation, rel=1e-4)
    assert np.all([row["preset"] == "tan" for row in rows])
