"""`--set key.path=value`."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinrender.errors import InputError
from skinrender.scene import load_scene
from skinrender.scene.overrides import apply_overrides
from skinrender.scene.yaml_source import Source


def test_values_replace_those_of_the_file(write_scene):
    scene = load_scene(write_scene(), ["skin.site=cheek", "patch.size_mm.1=3.5", "bands_nm=[500]"])
    assert scene.skin.site == "cheek"
    assert scene.patch.size_mm == (4, 3.5)
    assert scene.wavelength_nm == (500,)


def test_absent_sections_are_made(write_scene):
    overrides = ["photons.stored=1e7", "skin.layers.basal.melanosome=0.2", "camera.zenith_deg=30", "relief.seed=5"]
    scene = load_scene(write_scene(), overrides)
    assert scene.photons.stored == 10_000_000
    assert isinstance(scene.photons.stored, int)
    assert scene.skin.layers["basal"].melanosome == 0.2
    assert (scene.camera.kind, scene.camera.zenith_deg) == ("orthographic", 30)
    assert (scene.relief.kind, scene.relief.seed) == ("procedural", 5)


def test_an_empty_section_of_the_file_is_filled(write_scene, scene_text):
    assert load_scene(write_scene(scene_text + "photons:\n"), ["photons.seed=3"]).photons.seed == 3


def test_the_last_override_of_a_key_wins(write_scene):
    assert load_scene(write_scene(), ["photons.seed=3", "photons.seed=4"]).photons.seed == 4


def test_an_entry_of_a_list_is_set_by_its_index(write_scene, scene_text, tmp_path):
    (tmp_path / "a.png").touch()
    path = write_scene(scene_text + "lesions: [{kind: epidermal, pattern: a.png}]\n")
    assert load_scene(path, ["lesions.0.melanin_scale=0.1"]).lesions[0].melanin_scale == 0.1


def test_a_wavelength_of_a_table_is_set(write_scene, scene_text):
    path = write_scene(scene_text + "outside: {refractive_index: {400: 1, 600: 1.1}}\n")
    scene = load_scene(path, ["outside.refractive_index.600=1.2", "outside.refractive_index.700=1.3"])
    assert scene.outside.refractive_index == {400: 1, 600: 1.2, 700: 1.3}


def test_a_value_may_hold_an_equals_sign(write_scene):
    assert load_scene(write_scene(), ["description=a=b"]).description == "a=b"


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("photons.stored", "--set photons.stored: an override is key.path=value\n"),
        ("photons..stored=1", "--set photons..stored=1: an override is key.path=value\n"),
        ("=1", "--set =1: an override is key.path=value\n"),
        ("photons.stored=[1", "--set photons.stored=[1: not valid YAML: "),
        ("photons.stored=\x01", "--set photons.stored=\x01: character 0x0001 is not allowed"),
        ("photons.stored=1e7x", "--set photons.stored=1e7x: photons.stored: got '1e7x'; expected a whole number"),
        (
            "photons.stord=1",
            "--set photons.stord=1: photons.stord: unknown key; allowed: stored, seed, roulette, wavelengths (did you",
        ),
        ("photon.stored=1", "--set photon.stored=1: photon: unknown key; allowed: "),
        ("skin.site.x=1", "--set skin.site.x=1: skin.site holds 'forearm', which has no keys\n  set skin.site itself"),
        ("bands_nm.2=600", "--set bands_nm.2=600: '2' is no entry of the list bands_nm\n  its entries are 0 to 1"),
        ("bands_nm.-1=600", "--set bands_nm.-1=600: '-1' is no entry of the list bands_nm\n"),
        ("light={kind: sky, kind: point}", "--set light={kind: sky, kind: point}: light.kind: this key stands"),
        ("light={kind: sun}", "--set light={kind: sun}: light.kind: got 'sun'"),
        ("camera.center_mm=[9, 9]", "--set camera.center_mm=[9, 9]: camera.center_mm: got [9, 9], outside the patch"),
    ],
)
def test_a_mistake_points_at_the_override(write_scene, override, message):
    with pytest.raises(InputError) as caught:
        load_scene(write_scene(), [override])
    assert message in str(caught.value)


def test_a_mistake_of_the_file_that_an_override_mends_is_not_told(write_scene, scene_text):
    assert load_scene(write_scene(scene_text.replace("pont", "x")), ["light.kind=sky"]).light.kind == "sky"


KEYS = st.text("abcdefgh_", min_size=1, max_size=5)
SCALARS = st.none() | st.booleans() | st.integers(-(10**20), 10**20) | st.floats(allow_nan=False, allow_infinity=False)


@given(st.lists(KEYS, min_size=1, max_size=5), SCALARS)
def test_any_value_is_found_at_the_path_it_was_set_at(steps, value):
    source = Source(data={})
    apply_overrides(source, [".".join(steps) + "=" + {None: "null"}.get(value, str(value).lower())])
    found = source.data
    for step in steps:
        found = found[step]
    assert found == value
    assert str(source.marks[tuple(steps)]).startswith("--set ")
