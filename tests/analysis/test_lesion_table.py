"""Amount and depth of the pigment in the table's lesions, the depth of light, and the files."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from skinrender.analysis import lesion_sweep, light_depth
from skinrender.analysis.lesion_plot import draw_light_depth, draw_table
from skinrender.analysis.lesion_sweep import Row, forearm, pigment_of, sweep
from skinrender.analysis.lesion_table import markdown, write_csv
from skinrender.analysis.light_depth import LightDepth, write_light_depth
from skinrender.analysis.spectrum import spectrum
from skinrender.scene import make_scene
from skinrender.skin.builder import build_volume

LARGEST_Z = 4.0


def of_lesion(folder, lesion):
    return pigment_of(build_volume(forearm(folder, [lesion])), build_volume(forearm(folder)))


def test_amount_and_depth_of_dermal_melanin(tmp_path):
    # voxel layers 37 to 45 of the papillary layer's 37 to 46: 0.01 mm each, the uppermost left out
    lesion = {"kind": "dermal", "melanin_scale": 0.02, "center_layer": 41, "half_layers": 4}
    assert of_lesion(tmp_path, lesion) == pytest.approx((1.8, 0.075 + 0.01 + 0.045), rel=1e-5)


def test_amount_and_depth_of_ink(tmp_path):
    lesion = {"kind": "tattoo", "ink": "red", "volume_fraction": 0.004, "depth_mm": [0.26, 0.46]}
    assert of_lesion(tmp_path, lesion) == pytest.approx((0.8, 0.075 + 0.36), rel=1e-5)


def test_epidermal_melanin_lies_in_the_epidermis(tmp_path):
    amount_um, depth_mm = of_lesion(tmp_path, {"kind": "epidermal", "melanin_scale": 0.1})
    assert 1.0 < amount_um < 0.1 * 55 and 0.02 < depth_mm < 0.075


def test_dermal_rows_of_the_sweep_hold_equal_amounts(tmp_path):
    plain = forearm(tmp_path)
    dermal = [lesion for _, lesion in sweep(plain) if lesion["kind"] == "dermal"]
    amounts = [of_lesion(tmp_path, lesion)[0] for lesion in dermal]
    assert np.allclose(amounts, np.tile(lesion_sweep.MELANIN_UM, len(lesion_sweep.DERMAL)), rtol=1e-4)


@pytest.fixture(scope="module")
def found():
    slab = {"layers": [{"thickness_mm": 1, "mu_a_per_mm": 1, "mu_s_per_mm": 10, "g": 0.8, "refractive_index": 1.4}]}
    data = {"patch": {"size_mm": [1, 1], "columns": [1, 1]}, "bands_nm": {"step": 80}, "slab": slab}
    return spectrum(make_scene(data), stderr=0.1)


def test_files_of_the_table(found, tmp_path):
    row = Row("red", "0 to 1 mm", 0.9, 0.33, np.array([-2.0, 3.0, 0.25]), np.array([0.1, 0.2, 0.3]), found)
    write_csv([row], tmp_path / "table.csv")
    with open(tmp_path / "table.csv", newline="", encoding="utf-8") as file:
        [read] = csv.DictReader(file)
    assert read["lesion"] == "red" and float(read["da"]) == 3 and float(read["db_stderr"]) == 0.3
    assert "| red | 0 to 1 mm | 0.9 | 0.330 | -2.0 ± 0.1 | +3.0 ± 0.2 | +0.2 ± 0.3 |" in markdown([row])
    draw_table([row], tmp_path / "table.png")
    assert (tmp_path / "table.png").stat().st_size > 10_000


def test_mean_and_quantiles_of_a_known_distribution(tmp_path):
    depth = np.concatenate([[0.0], np.geomspace(0.001, 20.0, 400)])
    scale = np.array([0.2, 0.7])
    share = 1 - np.exp(-depth[:, None] / scale)
    known = LightDepth(np.array([450.0, 650.0]), depth, share, np.zeros_like(share))
    assert np.allclose(known.mean_mm, scale, rtol=2e-3)
    assert np.allclose(known.quantile_mm(0.5), scale * np.log(2), rtol=2e-3)
    write_light_depth(known, tmp_path / "depth.csv")
    draw_light_depth(known, tmp_path / "depth.png")
    assert (tmp_path / "depth.csv").read_text().splitlines()[1].startswith("450,0.2")


def test_red_light_has_been_deeper_than_blue(monkeypatch, tmp_path):
    monkeypatch.setattr(light_depth, "BELOW_MM", (0.0, 0.2, 0.9))

    def scene(*lesions):
        described = forearm(tmp_path, lesions).model_dump(mode="json", exclude_none=True)
        return make_scene(described | {"bands_nm": [450, 650]}, source_dir=tmp_path)

    found = light_depth.light_depth(scene, 0.04)
    blue, red = found.share.T
    assert found.depth_mm.tolist() == pytest.approx([0.0, 0.075, 0.275, 0.975])
    assert blue[0] == red[0] == 0 and np.all(np.diff(found.share, axis=0) > 0)
    assert np.all((blue - red)[1:3] > LARGEST_Z * np.hypot(*found.share_stderr[1:3].T))
    assert found.mean_mm[1] > 1.5 * found.mean_mm[0]


@pytest.mark.slow
def test_carbon_black_is_bluish_where_a_mole_is_brown(monkeypatch, tmp_path):
    mole = {"kind": "mole", "melanin_scale": 0.1, "depth_mm": 0.1}
    tattoo = {"kind": "tattoo", "volume_fraction": 0.0005, "depth_mm": [0.3, 0.6]}
    monkeypatch.setattr(lesion_sweep, "sweep", lambda plain: [("above", mole), ("below", tattoo)])
    above, below = lesion_sweep.rows(tmp_path, 0.02)
    assert above.lab[0] + LARGEST_Z * above.lab_stderr[0] < -5 and below.lab[0] + LARGEST_Z * below.lab_stderr[0] < -5
    assert np.all((above.lab - below.lab)[1:] > LARGEST_Z * np.hypot(above.lab_stderr, below.lab_stderr)[1:])
    assert np.all(below.lab[1:] + LARGEST_Z * below.lab_stderr[1:] < 0)
