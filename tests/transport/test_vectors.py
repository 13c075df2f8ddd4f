"""Vector operations on lanes against what their Python forms do."""

from __future__ import annotations

import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from numba.core.registry import cpu_target

from skinrender.transport import kernel
from skinrender.transport.lanes import ENDED, GROUP, INT_ROWS, LANES, LISTED, list_lanes
from skinrender.transport.vectors import DEALT, SQUEEZED, append_set, deal_rows
from tests.transport.block import row

GUARD = 64
PLAIN = {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": ""}


def can_squeeze() -> bool:
    """Whether kernels are compiled for a processor that has the instruction of `append_set`."""
    return "+avx512f" in cpu_target.target_context.codegen().magic_tuple()[-1].split(",")


@kernel
def appended(w, at, first, n, end):
    return append_set(w, at, first, n, end)


@kernel
def dealt(rows, at, words, f):
    deal_rows(
        rows, at[0], at[1], at[2], at[3], words, np.uint64(0), np.uint64(DEALT), np.uint64(2 * DEALT), f, np.uint64(0)
    )


def test_groups_are_whole_vectors():
    assert LANES % GROUP == 0 and GROUP % SQUEEZED == 0 and GROUP % DEALT == 0


@pytest.mark.parametrize("n", [0, 1, 15, 16, 17, 64, 200, LANES])
@pytest.mark.parametrize("share", [0.0, 0.03, 0.5, 1.0])
def test_lanes_that_are_set_are_listed_in_order(n, share):
    rng = np.random.default_rng(n)
    w = rng.integers(-9, 9, INT_ROWS * LANES + GUARD).astype(np.int32)
    row(w, ENDED)[:] = (rng.random(LANES) < share) * rng.choice([1, -1, 7, 1 << 30], LANES)
    before = w.copy()
    listed = list_lanes(w, n, np.uint32(ENDED))
    assert row(w, LISTED, int(listed)).tolist() == np.flatnonzero(row(before, ENDED, n)).tolist()
    row(w, LISTED)[:] = row(before, LISTED)
    assert np.array_equal(w, before), "nothing else is written, also not behind the last row"


@pytest.mark.parametrize("form", [appended, append_set])
def test_both_forms_list_the_same(form):
    rng = np.random.default_rng(1)
    for first in (0, 16, 48):
        words = np.zeros(128, np.int32)
        words[:64] = rng.integers(0, 2, 64)
        expected = [lane for lane in range(first, min(first + SQUEEZED, 60)) if words[lane]]
        count = int(form(words, np.uint64(first), first, 60, np.uint64(80)))
        assert words[80 : 80 + count].tolist() == expected


@pytest.mark.skipif(numba.config.DISABLE_JIT or not can_squeeze(), reason="this processor has no such instruction")
def test_a_processor_without_such_an_instruction_lists_the_same(tmp_path):
    environment = os.environ | PLAIN | {"NUMBA_CACHE_DIR": str(tmp_path)}
    asked = f"from {__name__} import can_squeeze; assert not can_squeeze(); import pytest; raise SystemExit(pytest.main())"
    done = subprocess.run(
        [sys.executable, "-c", asked, "-q", "-p", "no:cacheprovider", __file__], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


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


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize("w", [np.zeros(64, np.int64), np.zeros(128, np.int32)[::2], np.zeros((8, 8), np.int32)])
def test_words_that_are_no_vector_are_refused(w):
    with pytest.raises(numba.core.errors.TypingError):
        appended(w, np.uint64(0), 0, 16, np.uint64(32))
