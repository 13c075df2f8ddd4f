import subprocess
import sys
import warnings

import numpy as np
import pytest

from skinrender.film import color
from skinrender.optics import tables
from skinrender.optics.illuminants import band_weights

BANDS = np.arange(380.0, 781.0, 5.0)
LAMPS = ("D65", "D50", "A", "E", "LED-B3", "LED-RGB1")


@pytest.fixture(scope="module")
def colour():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    return colour


@pytest.fixture
def skin():
    return tables.columns("skin_reflectance_issa.csv")["JP_cheek_mean"]


def radiance_of(factor, irradiance):
    return factor * irradiance / np.pi


def test_observer_is_the_cies(colour):
    shape = colour.SpectralShape(380, 780, 5)
    expected = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape).values
    assert np.allclose(color.color_matching(BANDS), expected, rtol=1e-9)


@pytest.mark.parametrize("lamp", LAMPS)
def test_perfect_diffuser_is_white_whatever_the_lamp_and_its_power(lamp):
    for power in (1e-30, 1.0, 1e30):
        irradiance = power * band_weights(lamp, BANDS)
        exposure = color.exposure_for(irradiance, BANDS)
        rgb = radiance_of(1.0, irradiance) @ color.rgb_matrix(BANDS, irradiance, exposure)
        assert np.allclose(rgb, 1.0, atol=1e-12)
        assert radiance_of(1.0, irradiance) @ color.y_weights(BANDS, exposure) == pytest.approx(1.0)


@pytest.mark.parametrize("lamp", LAMPS)
def test_skin_under_a_lamp_matches_colour_science(colour, skin, lamp):
    irradiance = 7.0 * band_weights(lamp, BANDS)
    rgb = radiance_of(skin, irradiance) @ color.rgb_matrix(BANDS, irradiance, color.exposure_for(irradiance, BANDS))
    shape = colour.SpectralShape(380, 780, 5)
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    light = colour.SDS_ILLUMINANTS[lamp].copy().align(shape)
    xyz = colour.msds_to_XYZ(skin, method="Integration", cmfs=cmfs, illuminant=light, shape=shape) / 100
    white = colour.msds_to_XYZ(np.ones(81), method="Integration", cmfs=cmfs, illuminant=light, shape=shape) / 100
    d65 = colour.xy_to_XYZ(colour.RGB_COLOURSPACES["sRGB"].whitepoint)
    adapted = colour.adaptation.chromatic_adaptation_VonKries(xyz, white, d65, transform="Bradford")
    expected = colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB @ adapted
    assert np.allclose(rgb, expected, atol=3e-4)  # colour's published sRGB matrix has four digits


def test_luminance_of_rgb_is_y(skin):
    irradiance = band_weights("D65", BANDS)
    exposure = color.exposure_for(irradiance, BANDS)
    radiance = radiance_of(skin, irradiance)
    rgb = radiance @ color.rgb_matrix(BANDS, irradiance, exposure)
    # Not exactly: the tabulated D65 is adapted to the white of sRGB.
    assert rgb @ color.srgb_to_xyz()[1] == pytest.approx(radiance @ color.y_weights(BANDS, exposure), rel=1e-4)


def test_saturated_colors_are_not_clipped():
    irradiance = band_weights("E", BANDS)
    rgb = np.diag(irradiance) @ color.rgb_matrix(BANDS, irradiance, color.exposure_for(irradiance, BANDS))
    assert rgb.min() < 0


def test_one_band_is_shown_in_its_physical_unit():
    band = np.array([450], float)
    assert np.allclose(color.rgb_matrix(band, np.ones(1), exposure=5.0), 1e6)
    assert np.allclose(color.y_weights(band, exposure=5.0), 1e6)


@pytest.mark.parametrize("bands", [[600, 700], [450, 650], [900, 1000]])
def test_bands_that_cannot_show_color_are_grey(bands):
    bands = np.array(bands, float)
    light = np.ones(2) / 2
    assert not color.shows_color(bands, light)
    matrix = color.rgb_matrix(bands, light, color.exposure_for(light, bands))
    assert np.array_equal(matrix[:, 0], matrix[:, 1]) and np.array_equal(matrix[:, 0], matrix[:, 2])
    assert np.allclose(light / np.pi @ matrix, 1.0)


def test_three_bands_show_color():
    bands = np.array([450, 550, 650], float)
    light = np.ones(3)
    matrix = color.rgb_matrix(bands, light, color.exposure_for(light, bands))
    assert np.allclose(light / np.pi @ matrix, 1.0)
    assert matrix[2, 0] > matrix[2, 2] and matrix[0, 2] > matrix[0, 0]


def test_srgb_matrix_is_the_published_one(colour):
    assert np.allclose(color.srgb_to_xyz(), colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ, atol=1e-4)


def test_encoding_is_srgb(colour):
    linear = np.linspace(0, 1, 300).reshape(-1, 1).repeat(3, axis=1)
    encoded, clipped = color.encode_srgb(linear)
    assert np.array_equal(encoded, np.round(255 * colour.models.eotf_inverse_sRGB(linear)).astype(np.uint8))
    assert clipped == 0


def test_clipping_is_told():
    rgb = np.full((10, 10, 3), 0.5)
    rgb[0, 0, 1] = 1.2
    rgb[0, 1, 2] = -0.2
    encoded, clipped = color.encode_srgb(rgb)
    assert clipped == pytest.approx(0.02)
    assert encoded[0, 0, 1] == 255 and encoded[0, 1, 2] == 0


@pytest.mark.parametrize(
    ("group", "lab"),
    [("JP_cheek", (64.4, 12.0, 15.1)), ("JP_inner_arm", (66.4, 6.9, 16.3))],
)
def test_lab_of_measured_skin(group, lab):
    spectrum = tables.columns("skin_reflectance_issa.csv")[f"{group}_mean"]
    assert np.allclose(color.lab_of_factor(spectrum, BANDS), lab, atol=0.06)


def test_lab_of_measured_classes_reproduces_the_table_by_subject():
    mean = color.lab_of_factor(tables.columns("skin_reflectance_nist.csv")["mean"], BANDS)
    subjects = tables.columns("skin_lab_nist.csv")
    # The color of the mean is not the mean of the colors: half a unit over so wide a range of skin.
    assert np.allclose(mean, [subjects[axis].mean() for axis in "Lab"], atol=0.6)


def test_lab_of_a_grey_is_the_closed_form():
    for factor in (0.001, 0.18, 1.0):
        lightness = 116 * np.cbrt(factor) - 16 if factor > (6 / 29) ** 3 else factor * (29 / 3) ** 3
        for bands in (BANDS, np.array([450], float), np.array([600, 700], float), np.array([450, 550, 650], float)):
            lab = color.lab_of_factor(np.full(bands.size, factor), bands)
            assert np.allclose(lab, [lightness, 0, 0], atol=1e-6)


def test_sensitivity_of_color_is_the_derivative_of_lab(colour):
    """A white whose light changes by a thousandth in one band."""
    light = band_weights("D65", BANDS)
    xyz = light @ color.color_matching(BANDS)
    white = colour.XYZ_to_xy(xyz)
    for band in (4, 14, 34, 46, 60):
        changed = light.copy()
        changed[band] *= 1.001
        lab = colour.XYZ_to_Lab(changed @ color.color_matching(BANDS) / xyz[1], white)
        moved = np.linalg.norm(lab - colour.XYZ_to_Lab(xyz / xyz[1], white)) / 0.001
        assert color.color_sensitivity(BANDS, light)[band] == pytest.approx(moved, rel=2e-3)


def test_lab_of_rgb_white_and_grey():
    assert np.allclose(color.lab_of_rgb(np.ones(3)), [100, 0, 0], atol=1e-6)
    assert np.allclose(color.lab_of_rgb(np.full(3, 0.18)), [116 * np.cbrt(0.18) - 16, 0, 0], atol=1e-6)


def test_delta_e_2000_of_the_published_pair():
    # G. Sharma, W. Wu, E. N. Dalal, Color Res. Appl. 30, 21 (2005), table 1, pair 1.
    assert color.delta_e([50, 2.6772, -79.7751], [50, 0, -82.7485]) == pytest.approx(2.0425, abs=1e-4)


def test_typology_angle():
    assert color.ita_deg(np.array([[60.0, 0, 10], [50, 0, 10], [40, 0, 10]])) == pytest.approx([45, 0, -45])
    subjects = tables.columns("skin_lab_nist.csv")
    lab = np.stack([subjects[axis] for axis in "Lab"], axis=-1)
    assert np.allclose(color.ita_deg(lab), subjects["ITA_deg"], atol=0.1)


def test_a_picture_needs_no_import_of_colour_science():
    program = (
        "import sys, numpy as np; from skinrender.film import color, spectral_image, exr, png;"
        "color.rgb_matrix(np.arange(380., 781, 5), np.ones(81), 1.0);"
        "assert not {'colour', 'skimage', 'OpenEXR', 'matplotlib'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
