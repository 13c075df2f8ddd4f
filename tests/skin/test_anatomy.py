"""Layers and their optics."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.optics import chromophores
from skinrender.optics.measured_skin import TONES
from skinrender.optics.tissue import Tissue
from skinrender.scene import make_scene
from skinrender.skin.anatomy import (
    EPIDERMIS,
    LAYER_NAMES,
    LayerSpec,
    Tone,
    site_layers,
    skin_layers,
    slab_layers,
    toned,
    tones,
)
from skinrender.skin.builder import scene_layers

NM = np.array([450.0, 600.0])


def _skin(**layers):
    patch = {"size_mm": [1, 1], "columns": [4, 4]}
    return scene_layers(make_scene({"patch": patch, "bands_nm": [450, 600], "skin": {"layers": layers}}))


@pytest.mark.parametrize("site", ["forearm", "cheek"])
def test_sites_have_the_nine_layers(site):
    layers = site_layers(site)
    assert tuple(layer.name for layer in layers) == LAYER_NAMES
    reticular = layers[LAYER_NAMES.index("reticular")]
    assert reticular.thickness_mm / reticular.voxel_layers == pytest.approx(0.05)


def test_overrides_replace_only_what_they_name():
    layer = _skin(basal={"thickness_um": 12, "melanosome": 0.3, "voxel_layers": 3})[2]
    own = site_layers("forearm")[2]
    assert (layer.thickness_mm, layer.voxel_layers, layer.tissue.melanosome) == (0.012, 3, 0.3)
    assert layer.tissue.water == own.tissue.water and layer.explicit == {}


def test_impossible_composition_names_the_layer():
    with pytest.raises(InputError, match="subcutis"):
        _skin(subcutis={"water": 0.5})


def test_explicit_absorption_takes_added_melanin_on_top():
    layer = _skin(basal={"mu_a_per_mm": {400: 1, 800: 5}})[2]
    own = layer.tissue.melanosome
    mu_a = layer.optics(NM, np.array([own, own + 0.1])).mu_a
    assert np.allclose(mu_a[0], [1.5, 3.0]) and np.allclose(mu_a[1] - mu_a[0], 0.1 * chromophores.melanosome(NM))


def test_explicit_g_keeps_reduced_scattering():
    own = site_layers("forearm")[3]
    changed = LayerSpec(own.name, own.thickness_mm, 1, own.tissue, {"g": 0.5}).optics(NM, np.zeros(1))
    before = own.optics(NM, np.zeros(1))
    assert np.allclose(changed.g, 0.5) and np.allclose(changed.mu_s * 0.5, before.mu_s * (1 - before.g))


def test_slab_layers_are_named_from_the_top():
    described = [
        SimpleNamespace(name=name, thickness_mm=1, voxel_layers=1, mu_a_per_mm=1, mu_s_per_mm=2, g=0, refractive_index=1.4)
        for name in (None, "gel", None)
    ]
    assert [layer.name for layer in slab_layers(described)] == ["layer_1", "gel", "layer_3"]
    described[0].name = "gel"
    with pytest.raises(InputError, match="gel"):
        slab_layers(described)


def _toned(tone, **layers):
    return {layer.name: layer for layer in skin_layers("forearm", layers, tone)}


def test_darker_tones_hold_more_melanin_and_most_of_it_below():
    amounts = []
    for tone in TONES:
        layers = _toned(tone)
        share = {name: layers[name].tissue.melanosome for name in EPIDERMIS}
        assert share["basal"] >= 0.95 * max(share.values())
        amounts.append(sum(share[name] * layers[name].thickness_mm for name in EPIDERMIS))
    assert np.all(np.diff(amounts) > 0)


@pytest.mark.parametrize("tone", TONES)
def test_a_tone_changes_melanin_and_blood_alone(tone):
    for plain, toned_layer in zip(site_layers("forearm"), _toned(tone).values()):
        kept = {name: getattr(plain.tissue, name) for name in ("melanosome", "pheomelanin", "blood")}
        assert (replace(toned_layer.tissue, **kept), toned_layer.thickness_mm) == (plain.tissue, plain.thickness_mm)
        assert (toned_layer.tissue.blood > plain.tissue.blood) == (plain.tissue.blood > 0)


def test_tones_share_blood_and_the_kind_of_melanin():
    assert tuple(tones()) == TONES
    assert len({(tone.blood, tone.pheomelanin) for tone in tones().values()}) == 1


def test_dry_substance_keeps_its_melanosomes_up_to_the_surface():
    for tone in TONES:
        per_dry = [
            (layer := _toned(tone)[name]).tissue.melanosome / (1.0 - layer.tissue.water) for name in EPIDERMIS[:2]
        ]
        assert per_dry[0] == pytest.approx(per_dry[1], rel=0.01)


def test_a_scene_has_a_tone_and_its_layers_win_over_it():
    scene = {"patch": {"size_mm": [1, 1], "columns": [4, 4]}, "bands_nm": [550]}
    skin = {"tone": "brown", "layers": {"basal": {"melanosome": 0.25}}}
    layers = {layer.name: layer for layer in scene_layers(make_scene(scene | {"skin": skin}))}
    assert layers["basal"].tissue.melanosome == 0.25
    assert layers["granular_spinous"].tissue.melanosome == _toned("brown")["granular_spinous"].tissue.melanosome


def test_a_scene_says_what_melanin_it_has_and_lesions_have_it_too():
    def basal_mu_a(melanin, **skin):
        scene = {"patch": {"size_mm": [1, 1], "columns": [4, 4]}, "bands_nm": [450, 600], "skin": skin}
        return scene_layers(make_scene(scene))[2].optics(NM, np.array([melanin])).mu_a[0]

    law = chromophores.melanosome
    for skin, share in (({}, 0.0), ({"pheomelanin": 1}, 1.0), ({"tone": "tan"}, tones()["tan"].pheomelanin)):
        assert np.allclose(basal_mu_a(1.0, **skin), law(NM, share))
        explicit = {"layers": {"basal": {"mu_a_per_mm": 1, "melanosome": 0.1}}}
        assert np.allclose(basal_mu_a(0.3, **skin, **explicit), 1 + 0.2 * law(NM, share))
    assert np.allclose(basal_mu_a(1.0, tone="tan", pheomelanin=0), law(NM))


def test_fractions_end_at_one():
    tone = Tone({"basal": 2.0}, blood=2.0, pheomelanin=0.5)
    assert tone.on(Tissue(melanosome=0.6, blood=0.4), "basal") == Tissue(melanosome=1.0, blood=0.8, pheomelanin=0.5)


def test_an_unknown_tone_is_refused():
    with pytest.raises(InputError, match="green"):
        toned(site_layers("forearm"), "green")
