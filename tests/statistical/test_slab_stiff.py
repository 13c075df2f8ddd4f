"""Stacks of extreme contrast, against closed forms (no scattering) and against a plain walk in double precision."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from scipy import stats

from skinrender.analysis.slab_truth import Layer, SlabRecord, Stack
from skinrender.analysis.slab_walk import Accuracy, count_rounds, stack_scene
from skinrender.analysis.slabs import check_slabs
from skinrender.transport import tally
from tests.statistical.layered_walk import walk
from tests.stats import threshold

# thickness (mm), mu_a, mu_s (1/mm), g, n
INK = (1e-3, 300.0, 5.0, 0.5, 1.4)
CLEAR = {
    "glass on skin": [(1.0, 0.0, 0.0, 0.0, 1.52), (0.1, 3.0, 0.0, 0.0, 1.4), (2.0, 0.2, 0.0, 0.0, 1.4)],
    "ink, 1 m, ink": [(1e-3, 300.0, 0.0, 0.0, 1.5), (1e3, 1e-3, 0.0, 0.0, 1.3), (1e-3, 300.0, 0.0, 0.0, 1.5)],
    "six inks": [(1.0, 0.1, 0.0, 0.0, 1.3), (1e-3, 100.0, 0.0, 0.0, 1.5)] * 6,
    "denser outside": [(0.2, 1.0, 0.0, 0.0, 1.0), (0.3, 1.0, 0.0, 0.0, 3.0), (0.2, 0.5, 0.0, 0.0, 1.1)],
    "1 nm and 100 m": [(1e-6, 9e3, 0.0, 0.0, 1.4), (9e4, 1e-6, 0.0, 0.0, 1.4), (1e-6, 9e3, 0.0, 0.0, 1.6)],
}
TURBID = {
    "thin, 10 m, thin": [(1e-3, 5.0, 500.0, 0.9, 1.4), (1e4, 1e-5, 1e-3, 0.5, 1.33), (1e-3, 5.0, 500.0, 0.9, 1.4)],
    "ink under 500 mm": [(500.0, 0.0, 0.002, 0.5, 1.4), INK, (1.0, 0.1, 20.0, 0.8, 1.4)],
    "10 nm under 100 mm": [(100.0, 1e-4, 1e-2, 0.5, 1.4), (1e-5, 3e3, 7e3, 0.5, 1.33), (1.0, 0.1, 1.0, 0.5, 1.33)],
    "six inks": [(1.0, 0.01, 0.1, 0.5, 1.3), (1e-3, 100.0, 10.0, 0.5, 1.5)] * 6,
    "clear between": [(1.0, 0.1, 10.0, 0.8, 1.4), (5.0, 0.0, 0.0, 0.0, 1.0), (1.0, 0.1, 10.0, 0.8, 1.4)],
    "sharp both ways": [(0.5, 0.05, 10.0, -0.999, 1.4), (5.0, 0.05, 50.0, 0.999, 1.2)],
    "index 3 to 1": [(1.0, 0.1, 10.0, 0.8, 3.0), (1.0, 0.1, 10.0, 0.8, 1.0), (1.0, 0.1, 5.0, 0.0, 2.0)],
    "hardly absorbing": [(1.0, 1e-8, 10.0, 0.8, 1.4)],
}
QUADRATURE = 2e-4
BELOW = {"denser outside": 2.0, "index 3 to 1": 3.0}
ABOVE = {"denser outside": 1.5}


def stack_of(name: str, layers, incidence: str) -> Stack:
    described = tuple(Layer(*map(float, layer)) for layer in layers)
    return Stack(described, ABOVE.get(name, 1.0), BELOW.get(name, 1.0), incidence)


def border(cosine, n_from, n_to):
    """Reflectance, and the cosine beyond (0 under total reflection)."""
    sine2 = (n_from / n_to) ** 2 * (1.0 - cosine**2)
    beyond = np.sqrt(np.maximum(0.0, 1.0 - sine2))
    s = (n_from * cosine - n_to * beyond) / (n_from * cosine + n_to * beyond)
    p = (n_to * cosine - n_from * beyond) / (n_to * cosine + n_from * beyond)
    return np.where(sine2 < 1.0, 0.5 * (s**2 + p**2), 1.0), beyond


def without_scattering(stack: Stack, cosine: float) -> tuple[float, float, np.ndarray]:
    """R, T and absorption by layer of a beam: the fluxes down at the top and up at the bottom of each layer balance."""
    n = [stack.n_above, *(layer.n for layer in stack.layers), stack.n_below]
    count, reflected, passed = len(stack.layers), [], []
    for k, layer in enumerate(stack.layers):
        r, cosine = border(cosine, n[k], n[k + 1])
        reflected.append(float(r))
        if r == 1.0:
            return 1.0, 0.0, np.zeros(count)
        passed.append(np.exp(-layer.mu_a * layer.thickness_mm / cosine))
    reflected.append(float(border(cosine, n[-2], n[-1])[0]))
    r, t = np.array(reflected), np.array(passed)
    matrix, source = np.eye(2 * count), np.zeros(2 * count)
    source[0] = 1.0 - r[0]
    for k in range(count):
        matrix[k, count + k] -= r[k] * t[k]
        matrix[count + k, k] -= r[k + 1] * t[k]
        if k > 0:
            matrix[k, k - 1] -= (1.0 - r[k]) * t[k - 1]
        if k < count - 1:
            matrix[count + k, count + k + 1] -= (1.0 - r[k + 1]) * t[k + 1]
    down, up = np.split(np.linalg.solve(matrix, source), 2)
    absorbed = (down + up) * (1.0 - t)
    return r[0] + (1.0 - r[0]) * up[0] * t[0], (1.0 - r[-1]) * down[-1] * t[-1], absorbed


@cache
def diffuse_nodes() -> tuple[np.ndarray, np.ndarray]:
    """Cosines and weights of Lambertian light; 2000 nodes instead change the results by less than `QUADRATURE`."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    return np.sqrt(0.5 * (nodes + 1.0)), 0.5 * weights


def clear_record(name: str, incidence: str) -> dict:
    """A truth record of a stack that doesn't scatter."""
    stack = stack_of(name, CLEAR[name], incidence)
    cosines, share = diffuse_nodes() if incidence == "diffuse" else ([1.0], [1.0])
    parts = [without_scattering(stack, cosine) for cosine in cosines]
    r, t, absorbed = (sum(w * np.asarray(part[k]) for w, part in zip(share, parts)) for k in range(3))
    return {
        "id": f"{name}/{incidence}", "incidence": incidence, "n_above": stack.n_above, "n_below": stack.n_below,
        "layers": [vars(layer) for layer in stack.layers], "R_total": float(r), "T_total": float(t),
        "R_unscattered": float(r), "T_unscattered": float(t), "A_layers": absorbed.tolist(),
        "scatter_events": [0.0] * len(stack.layers), "accuracy": {"abs": QUADRATURE, "rel_max": 0.0},
    }  # fmt: skip


def test_closed_form_keeps_the_energy_and_knows_one_plate():
    record = clear_record("six inks", "normal")
    assert record["R_total"] + record["T_total"] + sum(record["A_layers"]) == pytest.approx(1.0, abs=1e-12)
    r, t, _ = without_scattering(Stack((Layer(1.0, 0.0, 0.0, 0.0, 1.5),), 1.0, 1.0, "normal"), 1.0)
    assert (r, t) == pytest.approx((2 * 0.04 / 1.04, 0.96 / 1.04))


def test_stacks_without_scattering_agree_with_closed_forms(tmp_path):
    path = tmp_path / "clear.json"
    records = [clear_record(name, incidence) for name in CLEAR for incidence in ("normal", "diffuse")]
    path.write_text(json.dumps({"schema": "layered-slab-truth/1", "records": records}))
    found = check_slabs(path, wanted=Accuracy(2e-3, 0.04), seed=3, workers=1)
    assert [result for result in found.results if not result.ok] == []


@pytest.mark.parametrize("incidence", ["normal", "diffuse"])
@pytest.mark.parametrize("name", TURBID)
def test_stacks_that_scatter_agree_with_a_plain_walk(name, incidence):
    stack, histories = stack_of(name, TURBID[name], incidence), 50_000
    mu_a, mu_s, g, n = (np.array([getattr(layer, key) for layer in stack.layers]) for key in ("mu_a", "mu_s", "g", "n"))
    index = np.array([stack.n_above, *n, stack.n_below])
    rng = np.random.default_rng(1)
    counts, squares = walk(np.array(stack.depth_mm), mu_a, mu_s, g, index, incidence == "diffuse", histories, rng)
    expected = counts / histories
    variance = (squares / histories - expected**2) / histories
    summary = count_rounds(stack_scene(SlabRecord({}, name, name, stack)), 7, histories)
    columns = [tally.REFLECTED, tally.TRANSMITTED, *range(tally.PER_LAYER, tally.columns(len(stack.layers)))]
    got, stderr = summary.fractions[0, columns], summary.fractions_stderr[0, columns]
    often = np.minimum(got, expected) * histories >= 100
    z = (got - expected)[often] / np.sqrt(variance + stderr**2)[often]
    assert often.sum() >= 3
    assert abs(z).max() < stats.norm.isf(0.5 * threshold(len(TURBID) * 2 * z.size)), np.round(z, 1)
