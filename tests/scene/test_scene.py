"""The models: defaults, shipped scenes, round trips, JSON Schema, hashes, import cost."""

import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinrender.errors import InputError
from skinrender.optics.illuminants import illuminant_names
from skinrender.optics.inks import ink_names
from skinrender.scene import BUILD_PARTS, ESTIMATE_PARTS, TRACE_PARTS, json_schema, load_scene, make_scene, scene_hash
from skinrender.scene.schema_lesion import INKS
from skinrender.scene.schema_light import ILLUMINANTS

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))
PATCH = {"size_mm": [10, 10], "columns": [200, 200]}
LAYER = {"thickness_mm": 1, "mu_a_per_mm": 0.1, "mu_s_per_mm": 10, "g": 0.8, "refractive_index": 1.4}


def skin_scene(**sections):
    return make_scene({"patch": PATCH, "skin": {}, **sections})


def slab_scene(*layers, **sections):
    return make_scene({"patch": PATCH, "slab": {"layers": [LAYER | layer for layer in layers]}, **sections})


def test_defaults_are_the_papers():
    scene = skin_scene()
    assert scene.wavelength_nm == tuple(range(380, 781, 5))
    assert (scene.light.kind, scene.light.height_mm, scene.light.spectrum) == ("point", 100, "D65")
    assert (scene.camera.kind, scene.camera.pixels) == ("orthographic", (200, 200))
    assert (scene.sides, scene.inner_borders, scene.below.refractive_index) == ("periodic", "auto", None)
    assert scene.estimate.gather_count is None


def test_relief_is_the_sites_for_skin_and_flat_for_a_slab():
    assert skin_scene().relief.kind == "procedural"
    assert slab_scene({}).relief.kind == "flat"
    assert skin_scene(relief={"kind": "flat"}).relief.kind == "flat"


@pytest.mark.parametrize(
    ("bands", "wavelengths"),
    [
        ({"step": 40}, tuple(range(380, 781, 40))),
        ({"start": 400, "stop": 470, "step": 20}, (400, 420, 440, 460)),
        ({"start": 500, "stop": 500.3, "step": 0.1}, (500, 500.1, 500.2, 500.3)),
        ({"start": 550, "stop": 550}, (550,)),
        ([450], (450,)),
        ([450, 460.5], (450, 460.5)),
    ],
)
def test_bands(bands, wavelengths):
    assert skin_scene(bands_nm=bands).wavelength_nm == wavelengths


def test_255_bands_are_the_most():
    assert len(skin_scene(bands_nm={"start": 400, "stop": 654, "step": 1}).wavelength_nm) == 255
    with pytest.raises(InputError, match="more than 255"):
        skin_scene(bands_nm={"start": 400, "stop": 655, "step": 1})


@pytest.mark.parametrize(
    "layer",
    [
        {"mu_a_per_mm": 700, "mu_s_per_mm": 500},
        {"mu_a_per_mm": 5000, "mu_s_per_mm": 5000, "thickness_mm": 500},
        {"mu_a_per_mm": 0, "mu_s_per_mm": 0, "thickness_mm": 2000},
        {"thickness_mm": 0.001, "g": 0.999},
        {"g": -0.999, "refractive_index": 1},
        {"g": 1e-9, "refractive_index": 1.55},
        {"mu_a_per_mm": {780: 1, 380: 2}},
    ],
)
def test_stiff_layers_are_accepted(layer):
    assert slab_scene(layer).slab.layer_names == ("layer_1",)


def test_tables_are_sorted_by_wavelength():
    assert list(slab_scene({"g": {780: 0.9, 380: 0.7, 500: 0.8}}).slab.layers[0].g) == [380, 500, 780]


def test_layers_are_named_by_number_from_the_top():
    assert slab_scene({}, {"name": "fat"}, {}).slab.layer_names == ("layer_1", "fat", "layer_3")


def test_a_lamp_may_stand_beside_the_patch():
    assert skin_scene(light={"position_mm": [-50, 5]}).light.position_mm == (-50, 5)


@pytest.mark.parametrize(
    "light",
    [
        {"radius_mm": 5},
        {"radius_mm": 2.4, "zenith_deg": 60, "azimuth_deg": 90},
        {"radius_mm": 0, "position_mm": [0, 10], "power_W": 3},
        {"irradiance_W_per_mm2": 1e30, "zenith_deg": 80},
    ],
)
def test_a_beam_on_the_patch_is_accepted(light):
    assert skin_scene(light={"kind": "collimated", **light}).light.kind == "collimated"


def test_the_illuminants_are_those_of_the_optics():
    assert set(ILLUMINANTS) == set(illuminant_names())


def test_the_inks_are_those_of_the_optics():
    assert ink_names() == INKS


def test_a_scene_can_not_be_changed():
    with pytest.raises(ValueError, match="frozen"):
        skin_scene().photons.seed = 3


def test_the_name_is_the_files_and_paths_are_relative_to_it(write_scene, tmp_path, monkeypatch):
    path = write_scene(name="my skin.v2.yaml")
    monkeypatch.chdir(tmp_path.parent)
    scene = load_scene(path.relative_to(tmp_path.parent))
    assert scene.name == "my skin.v2"
    assert scene.source_dir == tmp_path
    assert scene.path("../a.png") == tmp_path / ".." / "a.png"
    assert scene.path("/b/a.png") == Path("/b/a.png")


def test_shipped_scenes_are_there():
    assert len(CONFIGS) >= 11


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_shipped_scenes_load_and_say_what_they_are(path):
    scene = load_scene(path)
    assert scene.name == path.stem
    head = path.read_text().splitlines()[:2]
    assert all(line.startswith("# ") for line in head)


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_scene_survives_json_and_pickle(path):
    scene = load_scene(path)
    again = make_scene(scene.model_dump(mode="json"), source_dir=scene.source_dir)
    assert again == scene
    assert pickle.loads(pickle.dumps(scene)).path("x") == scene.path("x")


def test_the_common_scene_of_the_peers():
    red, blue = (load_scene(CONFIGS[0].parent / f"slab_{color}.yaml") for color in ("red", "blue"))
    for scene, mu_s, mu_a in ((red, 20, 0.03), (blue, 40, 0.6)):
        (layer,) = scene.slab.layers
        assert (layer.mu_s_per_mm, layer.mu_a_per_mm, layer.g, layer.refractive_index) == (mu_s, mu_a, 0.8, 1.4)
        assert (scene.patch.size_mm, layer.thickness_mm, scene.sides) == ((10, 10), 3, "dielectric")
        assert (scene.light.height_mm, scene.light.intensity_W_per_sr, scene.camera.distance_mm) == (20, 1000, 18)
        assert scene.below.refractive_index == 1


def test_the_json_schema_describes_every_key():
    schema = json_schema()
    nodes = [schema, *schema["$defs"].values()]
    undescribed = [
        f"{node['title']}.{key}"
        for node in nodes
        for key, value in node["properties"].items()
        if "description" not in value and key != "kind"
    ]
    assert undescribed == []
    assert all(node["additionalProperties"] is False for node in nodes)


def test_the_json_schema_accepts_shipped_scenes_and_refuses_mistakes():
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(json_schema())
    for path in CONFIGS:
        validator.validate(load_scene(path).model_dump(mode="json", exclude_unset=True))
    assert not validator.is_valid({"patch": PATCH, "skin": {"layers": {"basel": {}}}})


PARTS_OF_CHANGES = {
    "description=x": None,
    "name=x": None,
    "photons.stored=5": None,
    "patch.columns=[4, 4]": BUILD_PARTS,
    "bands_nm=[500]": BUILD_PARTS,
    "skin.site=cheek": BUILD_PARTS,
    "relief.seed=9": BUILD_PARTS,
    "sides=open": BUILD_PARTS,
    "below.refractive_index=1": BUILD_PARTS,
    "light.height_mm=50": TRACE_PARTS,
    "photons.seed=9": TRACE_PARTS,
    "photons.roulette=false": TRACE_PARTS,
    "camera.zenith_deg=5": ESTIMATE_PARTS,
    "finish.roughness=0.5": ESTIMATE_PARTS,
    "estimate.method=point": ESTIMATE_PARTS,
}


@pytest.mark.parametrize(("change", "first"), PARTS_OF_CHANGES.items())
def test_a_change_changes_the_hash_of_the_stages_that_read_it(write_scene, change, first):
    path = write_scene()
    before, after = load_scene(path), load_scene(path, [change])
    stages = [BUILD_PARTS, TRACE_PARTS, ESTIMATE_PARTS]
    changed = [scene_hash(before, parts) != scene_hash(after, parts) for parts in stages]
    start = stages.index(first) if first else len(stages)
    assert changed == [i >= start for i in range(len(stages))]


def test_the_hash_is_of_values_not_of_their_spelling(write_scene):
    text = "patch: {size_mm: [4, 2], columns: [8, 4]}\nskin: {}\nphotons: {seed: 1e1}\n"
    other = "skin: {site: forearm}\nphotons: {seed: 10}\npatch: {columns: [8.0, 4], size_mm: [4.0, 2e0]}\n"
    first, second = load_scene(write_scene(text)), load_scene(write_scene(other, name="b.yaml"))
    assert scene_hash(first, ESTIMATE_PARTS) == scene_hash(second, reversed(ESTIMATE_PARTS))


def test_the_hash_covers_the_bytes_of_named_files(tmp_path):
    for name in ("a.png", "b.npy", "c.csv"):
        (tmp_path / name).write_bytes(b"1")
    scene = make_scene(
        {
            "patch": PATCH,
            "skin": {},
            "lesions": [{"kind": "epidermal", "pattern": "a.png"}],
            "relief": {"kind": "height_map", "file": "b.npy", "um_per_unit": 1},
            "light": {"spectrum": "c.csv"},
        },
        source_dir=tmp_path,
    )
    build, trace = scene_hash(scene, BUILD_PARTS), scene_hash(scene, TRACE_PARTS)
    (tmp_path / "c.csv").write_bytes(b"2")
    assert scene_hash(scene, BUILD_PARTS) == build
    assert scene_hash(scene, TRACE_PARTS) != trace
    for name in ("a.png", "b.npy"):
        before = scene_hash(scene, BUILD_PARTS)
        (tmp_path / name).write_bytes(b"2")
        assert scene_hash(scene, BUILD_PARTS) != before
    (tmp_path / "a.png").unlink()
    with pytest.raises(InputError, match="a.png: cannot be read"):
        scene_hash(scene, BUILD_PARTS)


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.sampled_from(["point", "flat", "sky"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["kind", "start", "layers", "basal", "g", "seed", 5, 4.5, True, None]), inner, max_size=3
        )
    ),
    max_leaves=6,
)
SECTIONS = st.sampled_from([*json_schema()["properties"], "other", 7])


@settings(max_examples=150, deadline=None)
@given(st.dictionaries(SECTIONS, VALUES, max_size=4))
def test_any_data_is_a_scene_or_an_input_error(data):
    try:
        make_scene({"patch": PATCH, "skin": {}, **data})
    except InputError as error:
        assert "pydantic" not in str(error)
        assert "Input should" not in str(error)


def test_the_package_imports_no_numerical_library():
    code = "import sys, skinrender.scene; print({'numpy', 'numba', 'colour', 'scipy'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"
