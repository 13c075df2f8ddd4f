"""The generator against an implementation of its own in plain integers, and what it makes of neighboring histories."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from skinrender.transport import kernel
from skinrender.transport.rng import draw, mix64, next_word, seed_words, stream_key, uniform
from tests.stats import assert_fits, threshold

WORD, LONG = 2**32 - 1, 2**64 - 1
GOLDEN = 0x9E3779B97F4A7C15
STATES = [(1, 2, 3, 4), (0, 0, 0, 1), (WORD, WORD, WORD, WORD), (0x80000000, 0x7FFFFFFF, 0xDEADBEEF, 0x12345679)]


def xoshiro128plus(state, count):
    """Outputs and last state of xoshiro128+ in plain integers (Blackman and Vigna 2021, figure 3)."""
    a, b, c, d = state
    outputs = []
    for _ in range(count):
        outputs.append((a + d) & WORD)
        t = (b << 9) & WORD
        c ^= a
        d ^= b
        b ^= c
        a ^= d
        c ^= t
        d = ((d << 11) | (d >> 21)) & WORD
    return outputs, (a, b, c, d)


def signed(words):
    return np.array(words, dtype=np.uint32).view(np.int32)


@kernel
def first_uniforms(key, first, out):
    """First uniform variates out[i, :] of consecutive histories."""
    for i in range(out.shape[0]):
        w0, w1, w2, w3 = seed_words(key, first + i)
        for k in range(out.shape[1]):
            word, w0, w1, w2, w3 = next_word(w0, w1, w2, w3)
            out[i, k] = uniform(word)


@kernel
def many_seeds(key, first, out):
    """State words out[i, :] of consecutive histories."""
    for i in range(out.shape[0]):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = seed_words(key, first + i)


@kernel
def all_uniforms(words, out):
    """Uniform variates of given words."""
    for i in range(words.size):
        out[i] = uniform(words[i])


@pytest.mark.parametrize("state", STATES)
def test_next_word_is_xoshiro128plus(state):
    w, outputs = tuple(signed(state)), []
    for _ in range(200):
        word, *w = next_word(*map(np.int32, w))
        outputs.append(int(np.int32(word)) & WORD)
    expected, last = xoshiro128plus(state, 200)
    assert outputs == expected
    assert tuple(int(np.int32(word)) & WORD for word in w) == last


def test_known_answers():
    assert xoshiro128plus((1, 2, 3, 4), 6)[0] == [5, 12295, 25178119, 27286542, 39879690, 1140358681]
    expected = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    assert [int(mix64(np.uint64((1234567 + k * GOLDEN) & LONG))) for k in (1, 2, 3)] == expected


def test_seed_words_are_two_outputs_of_splitmix64():
    key = 0xFEDCBA9876543210
    for index in (0, 1, 12345, 2**40 + 7):
        low, high = (int(mix64(np.uint64((key + (2 * index + k) * GOLDEN) & LONG))) for k in (0, 1))
        expected = (low & WORD, low >> 32, high & WORD, (high >> 32) | 1)
        assert tuple(int(np.int32(w)) & WORD for w in seed_words(np.uint64(key), index)) == expected


def test_seed_words_are_distinct_and_never_all_zero():
    states = []
    for key in (stream_key(1, 0, 0), stream_key(1, 1, 0), stream_key(2, 0, 0), np.uint64(0)):
        words = np.empty((50_000, 4), np.int32)
        many_seeds(key, 0, words)
        states.append(words)
    states = np.concatenate(states)
    assert np.all(states[:, 3] & 1)
    assert len(np.unique(states, axis=0)) == len(states)


def test_keys_differ_for_each_seed_band_and_stage():
    keys = {int(stream_key(seed, band, stage)) for seed in (0, 1, 2**31) for band in range(81) for stage in range(3)}
    assert len(keys) == 3 * 81 * 3
    assert stream_key(3, 5, 0) == stream_key(3, 5, 0)


def test_uniform_is_in_range_never_0_and_rises_with_the_word():
    edges = np.array([0, 1, 2, 3, 2**31 - 1, 2**31, WORD - 300, WORD - 1, WORD], np.uint64)
    words = np.sort(np.concatenate([edges, np.random.default_rng(1).integers(0, 2**32, 10_000, np.uint64)]))
    out = np.empty(words.size, np.float32)
    all_uniforms(words.astype(np.uint32).view(np.int32), out)
    assert out[0] == np.float32(2.0**-32) and out[-1] == 1.0
    assert np.all(np.diff(out) >= 0.0)
    assert np.abs(out - (words + 0.5) / 2.0**32).max() < 2.0**-24


def test_first_numbers_of_neighboring_histories_are_uniform_and_independent():
    u = np.empty((200_000, 4), np.float32)
    first_uniforms(stream_key(7, 3, 0), 10**9, u)
    for k in range(4):
        assert_fits(np.histogram(u[:, k], np.linspace(0, 1, 102))[0], np.full(101, 1 / 101), comparisons=4)
    for a, b in ((u[:, 0], u[:, 1]), (u[:, 1], u[:, 2]), (u[:-1, 0], u[1:, 0]), (u[:-1, 3], u[1:, 3])):
        counts = np.histogram2d(a, b, bins=21, range=[(0, 1), (0, 1)])[0]
        assert_fits(counts.ravel(), np.full(441, 1 / 441), comparisons=4)
    r = np.corrcoef(np.concatenate([u[:-1], u[1:]], axis=1).T)
    p = 2.0 * stats.norm.sf(np.abs(r[np.triu_indices(8, 1)]) * np.sqrt(len(u)))
    assert p.min() > threshold(28)


def test_draw_takes_the_lanes_own_words():
    lanes = 3
    state = STATES[3]
    words = np.full(4 * lanes, 99, np.int32)
    words[1::lanes] = signed(state)
    expected, last = xoshiro128plus(state, 2)
    assert [draw(words, 1, lanes) for _ in range(2)] == [(w + 0.5) / 2.0**32 for w in expected]
    assert [int(w) & WORD for w in words[1::lanes]] == list(last)
    assert np.all(words[0::lanes] == 99) and np.all(words[2::lanes] == 99)
