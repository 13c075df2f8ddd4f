"""Vector operations on lanes against what their Python forms do."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.transport import kernel
from skinrender.transport.lanes import ENDED, LANES, LISTED, new_block
from skinrender.transport.vectors import DEALT, append_set, deal_rows
from skinrender.transport.walk import list_lanes
from tests.transport.block import row


@kernel
def appended(w, at, first, n, end):
    return append_set(w, at, first, n, end)


@kernel
def dealt(rows, at, words, f):
    deal_rows(
        rows, at[0], at[1], at[2], at[3], words, np.uint64(0), np.uint64(DEALT), np.uint64(2 * DEALT), f, np.uint64(0)
    )


@pytest.mark.parametrize("n", [0, 1, 15, 16, 17, 64, 200, LANES])
@pytest.mark.parametrize("share", [0.0, 0.03, 0.5, 1.0])
def test_lanes_that_are_set_are_listed_in_order(n, share):
    _, w = new_block(np.float32)
    rng = np.random.default_rng(n)
    row(w, ENDED)[:] = (rng.random(LANES) < share) * rng.choice([1, -1, 7, 1 << 30], LANES)
    before = w.copy()
    listed = list_lanes(w, n, np.uint32(ENDED))
    assert row(w, LISTED, int(listed)).tolist() == np.flatnonzero(row(before, ENDED, n)).tolist()
    row(w, LISTED)[:] = row(before, LISTED)
    assert np.array_equal(w, before), "nothing else is written"


def test_python_form_lists_the_same():
    rng = np.random.default_rng(1)
    for first in (0, 16, 48):
        words = np.zeros(128, np.int32)
        words[:64] = rng.integers(0, 2, 64)
        forms = words.copy(), words.copy()
        n, at, end = 60, np.uint64(first), np.uint64(80)
        counts = [int(form(each, at, first, n, end)) for form, each in zip((appended, append_set), forms)]
        assert counts[0] == counts[1]
        assert np.array_equal(forms[0][80 : 80 + counts[0]], forms[1][80 : 80 + counts[0]])


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_rows_are_dealt_to_four_lanes(real):
    rows = np.random.default_rng(2).integers(-(2**31), 2**31, 400).astype(np.int32)
    rows.view(np.float32)[2::4] = np.random.default_rng(3).uniform(-1.0, 1.0, 100)
    at = np.array([12, 396, 0, 200], np.uint64)
    words, f = np.zeros(3 * DEALT, np.int32), np.zeros(DEALT, real)
    dealt(rows, at, words, f)
    expected = rows.reshape(-1, 4)[at // 4]
    assert np.array_equal(words.reshape(3, DEALT), expected[:, [0, 1, 3]].T)
    assert np.array_equal(f, rows.view(np.float32).reshape(-1, 4)[at // 4, 2].astype(real))
    again, g = np.zeros_like(words), np.zeros_like(f)
    deal_rows(rows, *at, again, 0, DEALT, 2 * DEALT, g, 0)
    assert np.array_equal(again, words) and np.array_equal(g, f)
