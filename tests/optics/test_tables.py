import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.optics import tables


def test_linear_between_the_rows_of_a_table():
    oxygenated = tables.on_bands("hemoglobin.csv", "hbo2_per_cm_per_M", np.array([360.0, 361.0, 362.0]))
    assert np.allclose(oxygenated, [94744, (94744 + 92248) / 2, 92248])


@pytest.mark.parametrize("nm", [359.0, 801.0])
def test_outside_a_table_is_an_error_that_names_it(nm):
    with pytest.raises(InputError, match=f"hemoglobin.csv.*{nm:g} nm"):
        tables.on_bands("hemoglobin.csv", "hbo2_per_cm_per_M", np.array([500.0, nm]))


def test_fat_is_held_below_its_measurement_but_not_above():
    held = tables.on_bands("fat.csv", "fat_per_cm", np.array([380.0, 430.0]), hold_below=True)
    assert held[0] == held[1] == pytest.approx(0.08216)
    with pytest.raises(InputError):
        tables.on_bands("fat.csv", "fat_per_cm", np.array([900.0]), hold_below=True)


def test_shipped_columns_cannot_be_changed_by_accident():
    with pytest.raises(ValueError, match="read-only"):
        tables.columns("water.csv")["water_per_cm"][0] = 1.0


def test_users_numbers_and_mappings():
    bands = np.array([450.0, 500.0, 550.0])
    assert np.array_equal(tables.spectrum_on_bands(2, bands), [2, 2, 2])
    assert np.allclose(tables.spectrum_on_bands({600: 4, 400: 2}, bands), [2.5, 3, 3.5])
    with pytest.raises(InputError, match=r"scene\.yaml:3:5.*450 nm"):
        tables.spectrum_on_bands({500: 4, 600: 2}, bands, where="scene.yaml:3:5")
    with pytest.raises(InputError):
        tables.spectrum_on_bands({}, bands)


def test_spectrum_file_with_header_and_comments(tmp_path):
    file = tmp_path / "lamp.csv"
    file.write_text("# my lamp\nwavelength_nm,value\n400,1\n\n600,3\n")
    assert np.allclose(tables.spectrum_file_on_bands(file, np.array([400.0, 500.0])), [1, 2])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no 'wavelength_nm,value'"),
        ("400,1\nfive,2\n", "lamp.csv:2:1"),
        ("400,1\n500,nan\n", "lamp.csv:2:1"),
        ("400,1\n500,2,3\n", "lamp.csv:2:1"),
        ("500,1\n400,2\n", "lamp.csv:2:1.*ascend"),
        ("# mine\nnm,value\n400,1\n500,-2\n", "lamp.csv:4:1.*negative, got -2"),
    ],
)
def test_broken_spectrum_files_are_explained(tmp_path, text, message):
    file = tmp_path / "lamp.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        tables.read_spectrum_csv(file)


def test_missing_and_binary_spectrum_files(tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        tables.read_spectrum_csv(tmp_path / "absent.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputError, match="cannot read"):
        tables.read_spectrum_csv(tmp_path / "binary.csv")
