"""One test for each kind of mistake: place, key path, what was got, what is allowed, the remedy."""

import pytest

from skinrender.errors import InputError
from skinrender.scene import load_scene, make_scene

SLAB = """\
patch: {size_mm: [4, 2], columns: [8, 4]}
bands_nm: [450, 550]
slab:
  layers:
    - {thickness_mm: 1, mu_a_per_mm: 0.1, mu_s_per_mm: 10, g: 0.8, refractive_index: 1.4}
"""


def lines_of(error, path):
    """The message's lines, with the file's folder left out."""
    return str(error).replace(f"{path.parent}/", "").splitlines()


def mistakes(path, overrides=()):
    with pytest.raises(InputError) as caught:
        load_scene(path, overrides)
    return lines_of(caught.value, path)


# Text added to the scene above (whose last line is 6) -> the one line of the message.
ADDED = {
    "unknown section": (
        "photns: {stored: 1e6}",
        (
            "scene.yaml:7:1: photns: unknown key; allowed: name, description, patch, bands_nm, skin, slab, relief, outside, "
            "below, sides, inner_borders, lesions, light, camera, finish, photons, estimate (did you mean 'photons'?)"
        ),
    ),
    "unit forgotten in the key": (
        "  height: 50",
        (
            "scene.yaml:7:3: light.height: unknown key of kind 'point'; allowed: kind, height_mm, position_mm, "
            "intensity_W_per_sr, spectrum (did you mean 'height_mm'?)"
        ),
    ),
    "unit in the value": (
        "  height_mm: 50 mm",
        "scene.yaml:7:3: light.height_mm: got '50 mm'; expected a number >= 0.001 and <= 10000000, without quotes or unit",
    ),
    "bound": (
        "finish: {roughness: 0}",
        "scene.yaml:7:10: finish.roughness: got 0; expected a number > 0 and <= 1",
    ),
    "not finite": (
        "finish: {roughness: .nan}",
        "scene.yaml:7:10: finish.roughness: got nan; expected a number > 0 and <= 1",
    ),
    "fraction for a count": (
        "photons: {stored: 1.5}",
        "scene.yaml:7:11: photons.stored: got 1.5; expected a whole number >= 1 and <= 10000000000000",
    ),
    "truth value for a number": (
        "photons: {stored: true}",
        "scene.yaml:7:11: photons.stored: got true; expected a whole number >= 1 and <= 10000000000000",
    ),
    "yes for true": (
        "photons: {roulette: no}",
        "scene.yaml:7:11: photons.roulette: got 'no'; expected true or false (did you mean 'false'?)",
    ),
    "unknown word": (
        "sides: periodical",
        "scene.yaml:7:1: sides: got 'periodical'; allowed: 'periodic', 'open', 'dielectric' (did you mean 'periodic'?)",
    ),
    "number for a text": (
        "description: 5",
        "scene.yaml:7:1: description: got 5; expected text; put it in quotes",
    ),
    "name with a folder": (
        "name: a/b",
        "scene.yaml:7:1: name: got 'a/b'; expected text of 1 to 100 characters without / or \\",
    ),
    "plain value for a section": (
        "photons: 1e6",
        "scene.yaml:7:1: photons: got 1000000; expected a mapping with the keys stored, seed, roulette, wavelengths",
    ),
    "empty section": (
        "outside:",
        "scene.yaml:7:1: outside: got nothing; expected a mapping with the keys refractive_index",
    ),
    "unknown kind": (
        "relief: {kind: procedual}",
        (
            "scene.yaml:7:10: relief.kind: got 'procedual'; allowed: 'flat', 'procedural', 'height_map' "
            "(did you mean 'procedural'?)"
        ),
    ),
    "age of furrows that are given": (
        "relief: {age_years: 60, families: []}",
        "scene.yaml:7:1: relief: age_years has no effect on families that are given; remove it",
    ),
    "kind that is no word": (
        "camera: {kind: [1]}",
        "scene.yaml:7:10: camera.kind: got '[1]'; allowed: 'orthographic', 'perspective'",
    ),
    "missing kind": (
        "lesions: [{pattern: a.png}]",
        "scene.yaml:7:11: lesions.0.kind: missing; allowed: 'epidermal', 'dermal', 'mole', 'tattoo'",
    ),
    "missing key of a kind": (
        "camera: {kind: perspective}",
        "scene.yaml:7:1: camera.distance_mm: missing; add it: distance from the pinhole to the center",
    ),
    "key of another kind": (
        "camera: {distance_mm: 20}",
        (
            "scene.yaml:7:10: camera.distance_mm: unknown key of kind 'orthographic'; allowed: pixels, center_mm, "
            "window_mm, zenith_deg, azimuth_deg, cross_polarized, kind"
        ),
    ),
    "list for a section of kinds": (
        "relief: [1]",
        (
            "scene.yaml:7:1: relief: got a list of 1; expected a mapping with 'kind', which is one of "
            "'flat', 'procedural', 'height_map'"
        ),
    ),
    "mapping for a list": (
        "lesions: {kind: epidermal}",
        "scene.yaml:7:1: lesions: got a mapping; expected a list, each a mapping of kind epidermal or dermal or mole or tattoo",
    ),
    "pair of one": (
        "camera: {pixels: [32]}",
        "scene.yaml:7:10: camera.pixels: got a list of 1; expected a list of 2, each a whole number >= 1 and <= 8192",
    ),
    "pair of three": (
        "camera: {pixels: [32, 32, 3]}",
        "scene.yaml:7:10: camera.pixels: got a list of 3; expected a list of 2, each a whole number >= 1 and <= 8192",
    ),
    "entry of a pair": (
        "camera: {pixels: [32, -32]}",
        "scene.yaml:7:23: camera.pixels.1: got -32; expected a whole number >= 1 and <= 8192",
    ),
    "list for a coefficient": (
        "outside: {refractive_index: [1, 2]}",
        (
            "scene.yaml:7:11: outside.refractive_index: got a list of 2; expected a number >= 1 and <= 3 "
            "or a table {wavelength_nm: a number >= 1 and <= 3}"
        ),
    ),
    "value in a table": (
        "outside: {refractive_index: {400: 1, 600: 0.5}}",
        "scene.yaml:7:38: outside.refractive_index.600: got 0.5; expected a number >= 1 and <= 3",
    ),
    "key of a table": (
        "outside: {refractive_index: {red: 1}}",
        "scene.yaml:7:30: outside.refractive_index.red: got the key 'red'; a table's keys are wavelengths in nm, 100 to 3000",
    ),
    "table that ends too early": (
        "outside: {refractive_index: {400: 1, 500: 1}}",
        (
            "scene.yaml:7:11: outside.refractive_index: the table spans 400 to 500 nm, the bands 450 to 550 nm; "
            "add entries, or narrow bands_nm"
        ),
    ),
    "repeated key": (
        "sides: open\nsides: periodic",
        "scene.yaml:8:1: sides: this key stands here a second time (first at scene.yaml:7:1); keep one of them",
    ),
    "object tag": (
        "description: !!python/name:os.system x",
        (
            "scene.yaml:7:14: description: the tag !!python/name:os.system is not allowed; a scene holds plain values only, "
            "remove the tag"
        ),
    ),
    "camera beside the patch": (
        "camera: {center_mm: [1, 3]}",
        "scene.yaml:7:10: camera.center_mm: got [1, 3], outside the patch; expected a place from [0, 0] to [4, 2]",
    ),
    "unknown spectrum": (
        "  spectrum: D56",
        (
            "scene.yaml:7:3: light.spectrum: got 'D56'; allowed: 'D65', 'A', 'E', 'D50', 'LED-B1', 'LED-B2', 'LED-B3', "
            "'LED-B4', 'LED-B5', 'LED-BH1', 'LED-RGB1', 'LED-V1', 'LED-V2' or a .csv file (did you mean 'D65'?)"
        ),
    ),
    "height map of an unknown kind": (
        "relief: {kind: height_map, file: a.jpg}",
        "scene.yaml:7:1: relief: the file 'a.jpg' is of an unknown kind; allowed: .png, .tif, .tiff, .npy",
    ),
    "height image without its range": (
        "relief: {kind: height_map, file: a.png}",
        "scene.yaml:7:1: relief: a .png file needs range_um; add it",
    ),
    "height array with a range": (
        "relief: {kind: height_map, file: a.npy, um_per_unit: 1, range_um: [0, 1]}",
        "scene.yaml:7:1: relief: range_um has no effect on a .npy file; remove it",
    ),
    "heights upside down": (
        "relief: {kind: height_map, file: a.png, range_um: [50, -50]}",
        (
            "scene.yaml:7:41: relief.range_um: got [50.0, -50.0]; the first height must be the lower one: "
            "[of black, of white]"
        ),
    ),
    "skin and slab": (
        SLAB[SLAB.index("slab") :],
        "scene.yaml:7:1: slab: stands beside skin; a scene has either skin or slab, remove one of them",
    ),
}


@pytest.mark.parametrize(("added", "line"), ADDED.values(), ids=ADDED)
def test_a_mistake_is_told_in_one_line(write_scene, scene_text, added, line):
    assert mistakes(write_scene(scene_text + added + "\n")) == [line]


# A line of the scene -> what stands in its place, and the one line of the message.
REPLACED = {
    "unknown kind of light": (
        "  kind: point",
        "  kind: pont",
        "scene.yaml:6:3: light.kind: got 'pont'; allowed: 'point', 'collimated', 'sky' (did you mean 'point'?)",
    ),
    "missing section": (
        "patch: {size_mm: [4, 2], columns: [8, 4]}",
        "",
        "scene.yaml:2:1: patch: missing; add it: the piece of skin: size and voxel columns",
    ),
    "missing key": (
        "patch: {size_mm: [4, 2], columns: [8, 4]}",
        "patch: {size_mm: [4, 2]}",
        "scene.yaml:1:1: patch.columns: missing; add it: voxel columns along x and y; a pattern image has this many pixels",
    ),
    "bands that descend": (
        "bands_nm: [450, 550]",
        "bands_nm: [550, 450]",
        "scene.yaml:2:1: bands_nm: the wavelengths must ascend, but 450 follows 550; sort the list",
    ),
    "too many bands": (
        "bands_nm: [450, 550]",
        "bands_nm: {step: 1}",
        "scene.yaml:2:1: bands_nm: a step of 1 nm makes more than 255 bands; use a longer step",
    ),
    "range upside down": (
        "bands_nm: [450, 550]",
        "bands_nm: {start: 600, stop: 500}",
        "scene.yaml:2:1: bands_nm: stop (500) lies before start (600); exchange them",
    ),
    "band out of sight": (
        "bands_nm: [450, 550]",
        "bands_nm: [450, 900]",
        "scene.yaml:2:17: bands_nm.1: got 900; expected a number >= 380 and <= 780",
    ),
    "no bands": (
        "bands_nm: [450, 550]",
        "bands_nm: []",
        (
            "scene.yaml:2:1: bands_nm: got an empty list; expected a mapping with the keys start, stop, step "
            "or a list of 1 to 255 entries, each a number >= 380 and <= 780"
        ),
    ),
    "unknown layer": (
        "  site: forearm",
        "  layers: {basel: {melanosome: 0.2}}",
        (
            "scene.yaml:4:12: skin.layers.basel: unknown name; allowed: stratum_corneum, granular_spinous, basal, papillary, "
            "subpapillary, upper_plexus, reticular, lower_plexus, subcutis (did you mean 'basal'?)"
        ),
    ),
    "water and fat": (
        "  site: forearm",
        "  layers: {subcutis: {water: 0.5, fat: 0.6}}",
        "scene.yaml:4:12: skin.layers.subcutis: water (0.5) and fat (0.6) add up to more than 1; lower one of them",
    ),
    "absorption and composition": (
        "  site: forearm",
        "  layers: {basal: {mu_a_per_mm: 1, blood: 0.1}}",
        "scene.yaml:4:12: skin.layers.basal: mu_a_per_mm leaves no effect to blood; remove the one or the other",
    ),
    "empty skin": (
        "  site: forearm",
        "",
        "scene.yaml:3:1: skin: holds nothing; write 'skin: {site: forearm}'",
    ),
    "pencil beside the patch": (
        "  kind: point",
        "  {kind: collimated, radius_mm: 0, position_mm: [-1, 1]}",
        "scene.yaml:6:36: light.position_mm: got [-1, 1], outside the patch; expected a place from [0, 0] to [4, 2]",
    ),
    "pencil with an irradiance": (
        "  kind: point",
        "  {kind: collimated, radius_mm: 0, irradiance_W_per_mm2: 2}",
        "scene.yaml:6:36: light.irradiance_W_per_mm2: a pencil (radius_mm: 0) has no irradiance; give power_W",
    ),
    "beam with a power": (
        "  kind: point",
        "  {kind: collimated, radius_mm: 1, power_W: 2}",
        "scene.yaml:6:36: light.power_W: only a pencil (radius_mm: 0) has a power; give irradiance_W_per_mm2",
    ),
    "beam beyond the patch": (
        "  kind: point",
        "  {kind: collimated, radius_mm: 0.8, zenith_deg: 60, azimuth_deg: 90}",
        (
            "scene.yaml:6:22: light.radius_mm: got 0.8; the beam reaches beyond the patch, make it smaller or move it, "
            "or leave radius_mm out to light the whole patch"
        ),
    ),
    "place of a beam without an edge": (
        "  kind: point",
        "  {kind: collimated, position_mm: [1, 1]}",
        "scene.yaml:6:22: light.position_mm: has no effect on a beam over the whole patch; add radius_mm, or remove it",
    ),
}


@pytest.mark.parametrize(("old", "new", "line"), REPLACED.values(), ids=REPLACED)
def test_a_mistake_in_a_line_is_told(write_scene, scene_text, old, new, line):
    assert scene_text.count(old) == 1
    assert mistakes(write_scene(scene_text.replace(old, new))) == [line]


@pytest.mark.parametrize(
    ("added", "line"),
    [
        (
            "lesions: [{kind: epidermal, pattern: a.png}]",
            "scene.yaml:6:1: lesions: lesions need skin; remove them, or describe the tissue by skin in place of slab",
        ),
        (
            "relief: {kind: procedural}",
            "scene.yaml:6:1: relief.families: missing; only skin has furrows of its own, list those of the slab",
        ),
        (
            "    - {name: layer_1, thickness_mm: 1, mu_a_per_mm: 0, mu_s_per_mm: 0, g: 0, refractive_index: 1}",
            "scene.yaml:3:1: slab: two layers are named 'layer_1'; give each a name of its own",
        ),
        (
            "    - {thickness_mm: 1, mu_a_per_mm: 0, mu_s_per_mm: 0, g: 1, refractive_index: 1}",
            (
                "scene.yaml:6:57: slab.layers.1.g: got 1; expected a number > -1 and < 1 "
                "or a table {wavelength_nm: a number > -1 and < 1}"
            ),
        ),
    ],
)
def test_a_mistake_in_a_slab_is_told(write_scene, added, line):
    found = mistakes(write_scene(SLAB + added + "\n"))
    assert line in found
    # A pattern is looked for as well.
    assert [other for other in found if other != line and "no such file" not in other] == []


def test_neither_skin_nor_slab(write_scene):
    path = write_scene("patch: {size_mm: [4, 2], columns: [8, 4]}\n")
    line = "scene.yaml:1:1: has neither skin nor slab; add 'skin: {site: forearm}' or a slab with its layers"
    assert mistakes(path) == [line]


def test_a_missing_file_is_told_with_its_neighbor(write_scene, scene_text, tmp_path):
    (tmp_path / "macule.png").touch()
    path = write_scene(scene_text + "lesions:\n  - {kind: epidermal, pattern: makule.png}\n")
    assert mistakes(path) == [
        (
            f"scene.yaml:8:23: lesions.0.pattern: got 'makule.png'; there is no such file in '{tmp_path}' "
            "(did you mean 'macule.png'?); a path is relative to the scene file"
        )
    ]


def test_a_folder_is_no_pattern(write_scene, scene_text, tmp_path):
    (tmp_path / "macule.png").mkdir()
    [line] = mistakes(write_scene(scene_text + "lesions:\n  - {kind: epidermal, pattern: macule.png}\n"))
    assert "'macule.png', which is a folder or a device" in line


@pytest.mark.parametrize(("key", "meaning"), [("true", "true"), ("null", "nothing"), ("~", "nothing")])
def test_keys_that_are_no_words_are_told(write_scene, scene_text, key, meaning):
    [line] = mistakes(write_scene(scene_text + f"{key}: 1\n"))
    assert line.startswith(f"scene.yaml:7:1: the key '{key}' stands for {meaning}; ")


@pytest.mark.parametrize("key", [True, None, 1, 1.5])
def test_keys_of_plain_data_that_are_no_words_are_told(key):
    with pytest.raises(InputError, match="unknown key"):
        make_scene({"patch": {"size_mm": [1, 1], "columns": [1, 1]}, "skin": {}, key: 1})


def test_all_mistakes_are_told_at_once_in_the_order_of_the_file(write_scene, scene_text):
    text = scene_text.replace("forearm", "arm").replace("point", "pont")
    path = write_scene(
        text + "camera: {center_mm: [9, 9], pixel: [3, 3]}\nphotons: {seed: -1}\nseed: 3\nsides: open\nsides: x\n"
    )
    found = [line.split(": ")[:2] for line in mistakes(path, ["estimate.method=beem"])]
    assert found == [
        ["scene.yaml:4:3", "skin.site"],
        ["scene.yaml:6:3", "light.kind"],
        ["scene.yaml:7:29", "camera.pixel"],
        ["scene.yaml:8:11", "photons.seed"],
        ["scene.yaml:9:1", "seed"],
        ["scene.yaml:11:1", "sides"],
        ["--set estimate.method=beem", "estimate.method"],
    ]


def test_sections_that_are_right_are_checked_against_each_other_beside_wrong_ones(write_scene, scene_text):
    path = write_scene(scene_text.replace("forearm", "arm") + "camera: {center_mm: [9, 9]}\n")
    assert [line.split(": ")[1] for line in mistakes(path)] == ["skin.site", "camera.center_mm"]


@pytest.mark.parametrize(
    ("text", "words"), [("", "is empty"), ("# only\n", "is empty"), ("- 1\n", "is a mapping of keys")]
)
def test_a_file_without_keys_is_told(write_scene, text, words):
    with pytest.raises(InputError, match=words):
        load_scene(write_scene(text))


def test_plain_data_has_no_places():
    with pytest.raises(InputError, match=r"^photons\.seed: got 'a'; expected a whole number"):
        make_scene({"patch": {"size_mm": [1, 1], "columns": [1, 1]}, "skin": {}, "photons": {"seed": "a"}})


def test_a_wrong_layer_does_not_make_the_list_too_short(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(SLAB.replace("thickness_mm: 1,", "thickness_mm: -1,"), encoding="utf-8")
    [line] = mistakes(path)
    assert line.endswith("slab.layers.0.thickness_mm: got -1; expected a number >= 1e-09 and <= 100000")


def test_voxels_too_thin_are_told(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(SLAB.replace("thickness_mm: 1,", "thickness_mm: 1e-8, voxel_layers: 1000,"), encoding="utf-8")
    [line] = mistakes(path)
    assert "1000 voxel layers in 1e-08 mm are too thin" in line
