"""Scattering angles, directions and the choice at a collision."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.estimate.deposit import unpack_direction
from skinrender.transport import kernel, lanes, tally
from skinrender.transport.lanes import LANES, new_block
from skinrender.transport.medium import collision_thresholds
from skinrender.transport.phase import phase_hg
from skinrender.transport.rng import next_word, seed_words, uniform
from skinrender.transport.turn import collide, deflect, henyey_greenstein, pack_direction
from tests.stats import assert_fits, assert_mean, assert_share, bin_probabilities
from tests.transport.block import row

SCATTERINGS, COLUMNS = tally.PER_LAYER + 1, tally.columns(1)  # column of the only tissue layer, and how many there are
ANISOTROPY = [-0.999, -0.9, -0.3, 0.0, 1e-9, 0.5, 0.8, 0.95, 0.99, 0.999]
AXES = [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (1e-6, 0.0, -1.0), (0.6, 0.0, -0.8)]
WORD = 2.0**32


@kernel
def angles(g, u, out):
    for i in range(u.size):
        out[i, 0], out[i, 1] = henyey_greenstein(g, u[i])


@kernel
def random_uniforms(key, out):
    for i in range(out.size):
        out[i] = uniform(next_word(*seed_words(key, i))[0])


@kernel
def wander(direction, g, steps):
    """Direction after so many scatterings."""
    ux, uy, uz = direction[0], direction[1], direction[2]
    w0, w1, w2, w3 = seed_words(np.uint64(3), 0)
    for _ in range(steps):
        word, w0, w1, w2, w3 = next_word(w0, w1, w2, w3)
        v, sin = henyey_greenstein(g, uniform(word))
        word, w0, w1, w2, w3 = next_word(w0, w1, w2, w3)
        azimuth = np.float32(6.2831855) * uniform(word)
        ux, uy, uz = deflect(ux, uy, uz, v, sin, np.cos(azimuth), np.sin(azimuth))
    direction[0], direction[1], direction[2] = ux, uy, uz


@kernel
def packed(directions, codes):
    for i in range(codes.size):
        codes[i] = pack_direction(directions[i, 0], directions[i, 1], directions[i, 2])


def sampled(g, u):
    out = np.empty((u.size, 2), np.float32)
    angles(np.float32(g), np.asarray(u, np.float32), out)
    return out.astype(np.float64)


def uniforms(n, key=11):
    out = np.empty(n, np.float32)
    random_uniforms(np.uint64(key), out)
    return out


def cumulative(v, g):
    """Probability of 1 - cos(theta) below v: the integral of 2 pi phase_hg, without cancellation at any g."""
    t = np.sqrt((1.0 - g) ** 2 + 2.0 * g * v)
    return (1.0 + g) * v / (t * (t + 1.0 - g))


def unit_vectors(n, seed=1):
    v = np.random.default_rng(seed).normal(size=(n, 3))
    v = np.concatenate([v / np.linalg.norm(v, axis=1)[:, None], AXES])
    return v.astype(np.float32)


@pytest.mark.parametrize("g", ANISOTROPY)
def test_cumulative_is_the_integral_of_the_phase_function(g):
    edges = np.append(0.0, np.geomspace(1e-8, 2.0, 400))
    edges = edges if g >= 0.0 else np.sort(2.0 - edges)
    density = np.vectorize(lambda v: 2.0 * np.pi * phase_hg(1.0 - v, g))
    assert np.allclose(np.cumsum(bin_probabilities(density, edges)), cumulative(edges, g)[1:], atol=1e-9)


@pytest.mark.parametrize("g", ANISOTROPY)
def test_scattering_angles_follow_henyey_and_greenstein(g):
    v = sampled(g, uniforms(400_000))[:, 0]
    shares = np.linspace(0.0, 1.0, 102)
    edges = np.interp(shares, cumulative(grid := np.append(0.0, np.geomspace(1e-9, 2.0, 20_001)), g), grid)
    edges[0], edges[-1] = 0.0, 2.0
    assert_fits(np.histogram(v, edges)[0], np.diff(cumulative(edges, g)), 2 * len(ANISOTROPY))
    assert_mean(v, 1.0 - g, 2 * len(ANISOTROPY))


@pytest.mark.parametrize("g", [*ANISOTROPY, -0.999, -1e-9])
def test_angles_of_given_variates(g):
    u = np.array([2.0**-32, 1e-3, 0.1, 0.37, 0.5, 0.9, 0.999, 1.0 - 2.0**-24, 1.0], np.float32)
    v, sin = sampled(g, u).T
    exact_u, exact_g = u.astype(float), float(np.float32(g))
    base = 1.0 - exact_g + 2.0 * exact_g * exact_u
    s = (1.0 - exact_g**2) / base
    exact = (1.0 - exact_g) * (1.0 - exact_u) * (s + 1.0 - exact_g) / base
    assert np.allclose(v, exact, rtol=3e-4 if abs(g) > 0.99 else 2e-6, atol=1e-7)
    assert np.all((v >= 0.0) & (v <= 2.0)) and v[-1] == 0.0
    assert np.allclose(sin, np.sqrt(v * (2.0 - v)), rtol=1e-6, atol=1e-7)


def test_no_angle_is_lost_to_rounding_at_strong_anisotropy():
    v = sampled(0.999, uniforms(100_000))[:, 0]
    assert np.count_nonzero(v <= 0.0) <= 2


@pytest.mark.parametrize("axis", AXES)
def test_deflection_keeps_its_angle_and_turns_about_the_axis(axis):
    axis = np.array(axis) / np.linalg.norm(axis)
    turned = []
    for azimuth in np.arange(16) * (np.pi / 8):
        for v in (1e-6, 0.3, 1.9):
            sin = np.sqrt(v * (2.0 - v))
            out = np.array(deflect(*map(np.float32, (*axis, v, sin, np.cos(azimuth), np.sin(azimuth)))), float)
            assert out @ out == pytest.approx(1.0, abs=1e-6)
            assert out @ axis == pytest.approx(1.0 - v, abs=1e-6)
            if v == 0.3:
                turned.append(out)
    assert np.mean(turned, axis=0) == pytest.approx(0.7 * axis, abs=1e-6)
    assert np.linalg.matrix_rank(np.array(turned) - 0.7 * axis, tol=1e-3) == 2


@pytest.mark.parametrize("g", [0.0, 0.9, 0.999])
def test_length_stays_1_over_many_scatterings(g):
    direction = np.array([0.36, 0.48, -0.8], np.float32)
    wander(direction, np.float32(g), 100_000)
    assert np.linalg.norm(direction.astype(float)) == pytest.approx(1.0, abs=1e-6)


def test_packed_directions_are_exact_to_7e_5_rad():
    directions = unit_vectors(200_000)
    codes = np.empty(len(directions), np.int32)
    packed(directions, codes)
    low, high = (codes.view(np.uint32) & 0xFFFF).astype(np.uint16), (codes.view(np.uint32) >> 16).astype(np.uint16)
    step = max(1, len(directions) // 20_000)
    chosen = [*range(0, len(directions) - len(AXES), step), *range(len(directions) - len(AXES), len(directions))]
    back = np.array([unpack_direction(low[i], high[i]) for i in chosen])
    error = np.linalg.norm(np.cross(back, directions[chosen].astype(float)), axis=1)
    assert np.all(np.sum(back * directions[chosen], axis=1) > 0.999)
    assert error.max() < 7e-5
    assert np.abs((back - directions[chosen]).mean(axis=0)).max() < 1e-6


def collision_block():
    """Lanes with known generator states, directions and anisotropies; returns also the words that they will draw."""
    f, w = new_block(np.float32)
    words = np.empty((LANES, 3), np.int32)
    for i in range(LANES):
        state = seed_words(np.uint64(21), i)
        w[i], w[LANES + i], w[2 * LANES + i], w[3 * LANES + i] = state
        for k in range(3):
            words[i, k], *state = next_word(*map(np.int32, state))
    directions = unit_vectors(LANES - len(AXES), seed=5)
    row(f, lanes.UX)[:], row(f, lanes.UY)[:], row(f, lanes.UZ)[:] = directions.T
    row(f, lanes.G)[:] = np.resize(np.float32([-0.9, 0.0, 0.5, 0.8, 0.95]), LANES)
    return f, w, words, directions.astype(float)


def test_collision_of_given_words_has_the_closed_form():
    f, w, words, before = collision_block()
    row(w, lanes.SCATTER_BELOW)[:] = 2**31 - 1
    row(w, lanes.ABSORB_ABOVE)[:] = 2**31 - 1
    g = row(f, lanes.G).astype(float)
    collide(f, w, LANES, SCATTERINGS, COLUMNS)
    after = f.reshape(-1, LANES)[[lanes.UX // LANES, lanes.UY // LANES, lanes.UZ // LANES]].T.astype(float)
    assert np.all(row(w, lanes.EVENT) == SCATTERINGS)
    u = (words[:, 1].view(np.uint32) // 2 + 0.5) / 2.0**31
    base = 1.0 - g + 2.0 * g * u
    v = (1.0 - g) * (1.0 - u) * ((1.0 - g * g) / base + 1.0 - g) / base
    assert np.allclose((after * before).sum(axis=1), 1.0 - v, atol=1e-6)
    # azimuth about the flight in the frame of Duff et al. (2017)
    sign = np.copysign(1.0, before[:, 2])
    a = -1.0 / (sign + before[:, 2])
    x, y = before[:, 0], before[:, 1]
    t = np.stack([1.0 + sign * x * x * a, sign * x * y * a, -sign * x], axis=1)
    b = np.stack([x * y * a, sign + y * y * a, -y], axis=1)
    azimuth, sin = words[:, 2] * (2.0 * np.pi / WORD), np.sqrt(v * (2.0 - v))
    assert np.allclose((after * t).sum(axis=1), sin * np.cos(azimuth), atol=3e-5)
    assert np.allclose((after * b).sum(axis=1), sin * np.sin(azimuth), atol=3e-5)
    codes = np.empty(LANES, np.int32)
    packed(before.astype(np.float32), codes)
    assert np.array_equal(row(w, lanes.INCOMING), codes)


def test_thresholds_decide_to_the_very_word():
    f, w, words, before = collision_block()
    r = words[:, 0].astype(np.int64)
    scatter, absorb = (row(w, k) for k in (lanes.SCATTER_BELOW, lanes.ABSORB_ABOVE))
    kind = np.arange(LANES) % 4
    scatter[:] = np.clip(np.where(kind == 0, r + 1, np.where(kind == 2, r - 100, r)), -(2**31), 2**31 - 1)
    absorb[:] = np.clip(np.where(kind == 2, r - 1, r), -(2**31), 2**31 - 1)
    collide(f, w, LANES, SCATTERINGS, COLUMNS)
    event = row(w, lanes.EVENT)
    assert np.array_equal(
        event, np.array([SCATTERINGS, tally.COLLISIONS_NULL, tally.PER_LAYER, tally.COLLISIONS_NULL])[kind]
    )
    after = f.reshape(-1, LANES)[[lanes.UX // LANES, lanes.UY // LANES, lanes.UZ // LANES]].T
    moved = np.any(after != before.astype(np.float32), axis=1)
    assert moved[event == SCATTERINGS].all() and not moved[event != SCATTERINGS].any()


def chance(mu_a, mu_s, majorant):
    """Probabilities (scattering, absorption) that the thresholds give."""
    scatter, absorb = collision_thresholds(np.array([mu_a]), np.array([mu_s]), np.array([majorant]))[0, 0].astype(float)
    return (scatter + 2.0**31) / WORD, (2.0**31 - 1 - absorb) / WORD


@pytest.mark.parametrize("albedo", [0.0, 1e-6, 0.3, 0.999, 1.0 - 1e-6, 1.0])
@pytest.mark.parametrize("null", [0.0, 0.4])
def test_thresholds_give_the_albedo_to_2_32nds(albedo, null):
    majorant = 700.0
    mu_t = (1.0 - null) * majorant
    scatter, absorb = chance((1.0 - albedo) * mu_t, albedo * mu_t, majorant)
    assert scatter == pytest.approx(albedo * (1.0 - null), abs=1.5 / WORD)
    assert absorb == pytest.approx((1.0 - albedo) * (1.0 - null), abs=1.5 / WORD)


def test_what_cannot_happen_has_no_word_at_all():
    assert chance(0.0, 0.0, 1.0) == (0.0, 0.0)
    assert chance(0.0, 5.0, 5.0)[1] == 0.0
    assert chance(5.0, 0.0, 5.0)[0] == 0.0


def test_events_occur_in_their_shares():
    f, w, _, _ = collision_block()
    scatter, absorb = collision_thresholds(np.array([1.5]), np.array([5.0]), np.array([8.0]))[0, 0]
    row(w, lanes.SCATTER_BELOW)[:], row(w, lanes.ABSORB_ABOVE)[:] = scatter, absorb
    counts = np.zeros(SCATTERINGS + 1, int)
    for _ in range(400):
        collide(f, w, LANES, SCATTERINGS, COLUMNS)
        counts += np.bincount(row(w, lanes.EVENT), minlength=SCATTERINGS + 1)
    for event, share in ((tally.COLLISIONS_NULL, 1.5 / 8), (SCATTERINGS, 5 / 8), (tally.PER_LAYER, 1.5 / 8)):
        assert_share(counts[event], counts.sum(), share, 3)


def test_a_flight_that_ended_on_a_border_has_no_collision():
    f, w, _, before = collision_block()
    row(w, lanes.SCATTER_BELOW)[:] = np.where(np.arange(LANES) % 2 == 0, 2**31 - 1, -(2**31))  # else all are absorbed
    row(w, lanes.ABSORB_ABOVE)[:] = np.where(np.arange(LANES) % 2 == 0, 2**31 - 1, -(2**31))
    border = row(w, lanes.BORDER)
    border[:] = np.arange(LANES) % 5 == 0
    collide(f, w, LANES, SCATTERINGS, COLUMNS)
    assert np.array_equal(row(w, lanes.EVENT) == tally.BORDER_HITS, border == 1)
    assert not np.any(row(w, lanes.ENDED)[border == 1])
    after = f.reshape(-1, LANES)[[lanes.UX // LANES, lanes.UY // LANES, lanes.UZ // LANES]].T
    assert np.array_equal(after[border == 1], before[border == 1].astype(np.float32))


def test_events_are_counted_in_their_own_band():
    f, w, _, _ = collision_block()
    row(w, lanes.SCATTER_BELOW)[:] = 2**31 - 1
    row(w, lanes.ABSORB_ABOVE)[:] = 2**31 - 1
    row(w, lanes.BAND)[:] = np.arange(LANES) % 81
    collide(f, w, LANES, SCATTERINGS, COLUMNS)
    assert np.array_equal(row(w, lanes.EVENT), SCATTERINGS + COLUMNS * (np.arange(LANES) % 81))
