"""What a plan predicts is what happens, and each feature follows the scene."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from skinrender.engine import timed, view
from skinrender.engine import trace as trace_module
from skinrender.engine.features import Planned, features_of
from skinrender.engine.plan import make_plan
from skinrender.engine.trace import trace
from skinrender.engine.view import View
from skinrender.errors import InputError
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.scene import load_scene, make_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import save_volume

CONFIGS = Path(__file__).parents[2] / "configs"
FEW = ["bands_nm=[450,550,650]", "photons.stored=4e4", "camera.pixels=[8,8]"]
SCENES = {
    "smoke": ("smoke_beam", FEW),
    "slab": ("slab_blue_matched", ["photons.stored=1e5", "camera.pixels=[8,8]"]),
    "lesion": ("fig14_deep", [*FEW, "relief={kind: flat}", "skin.border_wave.peak_to_valley_um=0"]),
    "all photons": ("smoke_beam", [*FEW, "photons.roulette=false", "photons.stored=2e5"]),
}
ONE_BAND = {
    "patch": {"size_mm": [1, 1], "columns": [1, 1]},
    "bands_nm": [550],
    "slab": {
        "layers": [{"thickness_mm": 1, "mu_a_per_mm": 1, "mu_s_per_mm": 5, "g": 0.5, "refractive_index": 1.4}]
    },
    "light": {"kind": "collimated"},
    "camera": {"pixels": [4, 4]},
    "photons": {"stored": 3000},
}


def scene_named(name: str):
    if name == "one band":
        return make_scene(ONE_BAND)
    config, overrides = SCENES[name]
    return load_scene(CONFIGS / f"{config}.yaml", overrides)


@pytest.fixture
def quick(monkeypatch):
    """Timed runs too short to time anything."""
    monkeypatch.setattr(timed, "ENOUGH_SECONDS", 0.01)
    monkeypatch.setattr(timed, "MORE_PHOTONS", 1e4)
    monkeypatch.setattr(timed, "WRITTEN_BYTES", 1000)


def within(predicted: float, happened: float) -> bool:
    return happened / 1.2 <= predicted <= happened * 1.2


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("name", [*SCENES, "one band"])
def test_photons_and_bytes_are_what_happens(name, tmp_path, monkeypatch):
    scene = scene_named(name)
    plan = make_plan(scene)
    save_volume(build_volume(scene), tmp_path / "volume.npz")
    held = []
    finish = trace_module.finish_map

    def finish_and_look(*arguments):
        finish(*arguments)
        held.append(sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file()))

    monkeypatch.setattr(trace_module, "finish_map", finish_and_look)
    summary = trace(scene, tmp_path / "volume.npz", tmp_path, progress=False)
    assert within(plan.photons_stored, summary.stored)
    assert within(plan.photons_emitted, summary.emitted)
    assert within(plan.rounds, summary.rounds)
    assert plan.bytes["volume"] == (tmp_path / "volume.npz").stat().st_size
    assert within(plan.bytes["photons"], (tmp_path / "photons.npz").stat().st_size)
    section = 50_000
    assert within(plan.bytes["disk_peak"], held[0] + section)


@pytest.mark.usefixtures("quick")
def test_plan_is_json_with_seconds_of_each_stage():
    told = make_plan(make_scene(ONE_BAND)).as_json()
    json.dumps(told)
    stages = ["build", "trace", "estimate", "write"]
    assert list(told["seconds"]) == [*stages, "total"]
    assert all(told["seconds"][stage] > 0 for stage in stages)
    assert told["seconds"]["total"] == pytest.approx(sum(told["seconds"][stage] for stage in stages))
    assert {"volume", "photons", "disk_peak", "memory"} <= told["bytes"].keys()


@pytest.mark.usefixtures("quick")
def test_a_scene_that_stores_nothing_has_a_plan():
    layer = ONE_BAND["slab"]["layers"][0] | {"mu_s_per_mm": 0}
    plan = make_plan(make_scene(ONE_BAND | {"slab": {"layers": [layer]}}))
    assert plan.photons_stored == 0 < plan.photons_emitted


MEASURED = """
import resource, subprocess, sys
done = subprocess.run([sys.executable, "-m", "skinrender.cli", *sys.argv[1:]], stdout=subprocess.DEVNULL)
print(done.returncode, 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def peak_of(*arguments: object) -> int:
    """Most memory that a command held."""
    command = [sys.executable, "-c", MEASURED, *map(str, arguments)]
    code, peak = map(int, subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())
    assert code == 0
    return peak


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("method", ["beam", "point"])
@pytest.mark.parametrize("config, pixels", [("smoke_beam", 16), ("smoke_beam", 150), ("fig12_epidermal", 50)])
def test_memory_is_what_the_stages_take(tmp_path, config, pixels, method):
    """Small pictures take what the program itself takes, large ones of many bands what their arrays do."""
    given = [f"camera.pixels=[{pixels},{pixels}]", "bands_nm={start: 380, stop: 780, step: 5}", f"estimate.method={method}"]
    given += ["photons.stored=1e5"]
    path = CONFIGS / f"{config}.yaml"
    command = [path, *(word for value in given for word in ("--set", value)), "-o", tmp_path]
    predicted = make_plan(load_scene(path, given)).memory
    subprocess.run([sys.executable, "-m", "skinrender.cli", "render", *map(str, command)], check=True)
    for stage in ("build", "trace", "estimate"):
        happened = peak_of(stage, *command)
        assert within(predicted[stage], happened), (stage, predicted[stage], happened)


FLAT_SKIN = {
    "patch": {"size_mm": [1, 1], "columns": [4, 4]},
    "bands_nm": [450, 550, 650],
    "skin": {"site": "forearm", "border_wave": {"peak_to_valley_um": 0}},
    "relief": {"kind": "flat"},
    "camera": {"pixels": [4, 4]},
}
LAYERS = [dict(ONE_BAND["slab"]["layers"][0], refractive_index=n) for n in (1.4, 1.5)]
TWO_LAYERS = ONE_BAND | {"slab": {"layers": LAYERS}}
PATTERN = {"patch": {"size_mm": [4, 4], "columns": [80, 80]}}
MACULE = PATTERN | {
    "lesions": [{"kind": "epidermal", "pattern": str(CONFIGS / "../patterns/macule_80.png"), "melanin_scale": 0.25}]
}
TATTOO = PATTERN | {
    "lesions": [
        {"kind": "tattoo", "pattern": MACULE["lesions"][0]["pattern"], "volume_fraction": 0.01, "depth_mm": [0.1, 0.5]}
    ]
}
FURROWS = {"relief": {"kind": "procedural"}}
THIN = dict(ONE_BAND["slab"]["layers"][0], thickness_mm=1e-7)


def features(data: dict, workers: int | None = None) -> dict[str, tuple[bool, str]]:
    scene = make_scene(data)
    volume = build_volume(scene)
    walker = PhotonPass(volume, light_from_scene(scene), 1, roulette=scene.photons.roulette)
    planned = Planned(scene, volume, walker, 0.1, scene.photons.stored, workers)
    return {row.feature: (row.used, row.reason) for row in features_of(planned)}


SWITCHES = [
    ("lesion melanin grid", FLAT_SKIN | PATTERN, FLAT_SKIN | MACULE, "no lesions"),
    ("tattoo ink", FLAT_SKIN | MACULE, FLAT_SKIN | TATTOO, "no tattoo"),
    ("relief height field", FLAT_SKIN, FLAT_SKIN | FURROWS, "plane"),
    ("border wave", FLAT_SKIN, FLAT_SKIN | {"skin": {"site": "forearm"}}, "height is 0"),
    ("border wave", ONE_BAND, FLAT_SKIN | {"skin": {"site": "cheek"}}, "slabs have none"),
    ("periodic sides", ONE_BAND | {"sides": "open"}, ONE_BAND, "open"),
    ("inner-border Fresnel", ONE_BAND, TWO_LAYERS, "one index"),
    ("inner-border Fresnel", TWO_LAYERS | {"inner_borders": "matched"}, TWO_LAYERS, "is matched"),
    ("inner-border Fresnel", FLAT_SKIN, FLAT_SKIN | {"inner_borders": "fresnel"}, "layers of skin"),
    ("surface Fresnel", ONE_BAND | {"outside": {"refractive_index": 1.4}}, ONE_BAND, "same on both sides"),
    ("dispersion", ONE_BAND, ONE_BAND | {"bands_nm": [450, 650], "outside": {"refractive_index": {380: 1, 780: 1.1}}}, "no index"),
    ("spectrum", FLAT_SKIN | {"bands_nm": [550]}, FLAT_SKIN, "one band"),
    ("float64 blocks", ONE_BAND, ONE_BAND | {"slab": {"layers": [*LAYERS, THIN]}}, "float32 resolves"),
    ("single-scattering term", FLAT_SKIN | FURROWS, FLAT_SKIN, "through a relief"),
    ("single-scattering term", ONE_BAND | {"light": {"kind": "collimated", "radius_mm": 0}}, ONE_BAND, "pencil"),
    ("single-scattering term", ONE_BAND | {"light": {"kind": "sky"}, "sides": "open"}, ONE_BAND | {"light": {"kind": "sky"}}, "sides"),
    ("roulette on storage", ONE_BAND | {"photons": {"stored": 10, "roulette": False}}, ONE_BAND, "is false"),
    ("roulette on storage", ONE_BAND | {"slab": {"layers": [LAYERS[0] | {"thickness_mm": 0.1}]}}, ONE_BAND, "too deep"),
    ("worker processes", ONE_BAND, ONE_BAND | {"photons": {"stored": 10**8}}, "fewer than"),
    ("picture", FLAT_SKIN | FURROWS | {"inner_borders": "fresnel"}, FLAT_SKIN, "not flat"),
    ("depth limit", ONE_BAND, FLAT_SKIN, "from all"),
    ("kernel radius bound", FLAT_SKIN | PATTERN, FLAT_SKIN | MACULE, "alike"),
    ("kernel radius bound", FLAT_SKIN | MACULE | {"estimate": {"method": "point"}}, FLAT_SKIN | MACULE, "point"),
    ("surface reflection", ONE_BAND | {"camera": {"pixels": [4, 4], "cross_polarized": True}}, ONE_BAND, "cross-polarized"),
    ("surface reflection", ONE_BAND | {"outside": {"refractive_index": 1.4}}, ONE_BAND, "same on both sides"),
    ("subpixel rays", FLAT_SKIN, FLAT_SKIN | FURROWS, "one ray"),
]


@pytest.mark.parametrize(("name", "without", "within", "reason"), SWITCHES, ids=[f"{s[0]}: {s[3]}" for s in SWITCHES])
def test_a_feature_follows_the_scene(name, without, within, reason):
    used, told = features(without)[name]
    assert not used and reason in told
    used, told = features(within)[name]
    assert used and reason not in told


def test_every_feature_is_switched_by_a_test():
    assert set(features(ONE_BAND)) == {switch[0] for switch in SWITCHES}


def test_worker_processes_asked_for():
    assert features(ONE_BAND, workers=2)["worker processes"] == (True, "2 asked for")
    assert not features(ONE_BAND, workers=1)["worker processes"][0]


def test_no_roulette_stores_the_same_photons_where_nothing_is_thinned():
    """What the plan leaves out would have changed nothing."""
    scene = make_scene(ONE_BAND | {"slab": {"layers": [LAYERS[0] | {"thickness_mm": 0.1}]}})
    volume = build_volume(scene)
    rounds = [
        PhotonPass(volume, light_from_scene(scene), 1, roulette=roulette).walk(0, np.array([500]), True)
        for roulette in (False, True)
    ]
    assert np.array_equal(rounds[0].position, rounds[1].position)


def test_a_picture_larger_than_memory_is_refused_before_it_begins(monkeypatch):
    scene = make_scene(ONE_BAND)
    volume = build_volume(scene)
    walker = PhotonPass(volume, light_from_scene(scene), 1)
    photon_map = timed.round_as_map(walker, walker.walk(0, np.array([50]), True), 1)
    monkeypatch.setattr("skinrender.skin.memory.available_bytes", lambda: 1000)
    with pytest.raises(InputError, match="a picture of 4 x 4 pixels in 1 bands takes"):
        timed.estimate(scene, volume, photon_map, progress=False)


def test_matched_surfaces_reflect_nothing(monkeypatch):
    """What the estimate leaves out at equal indices would have been zero."""
    scene = make_scene(ONE_BAND | {"outside": {"refractive_index": 1.4}})
    volume = build_volume(scene)
    assert not View(scene, volume, "beam").surface.any()
    monkeypatch.setattr(view, "why_no_reflection", lambda *_: None)
    assert not View(scene, volume, "beam").surface.any()
