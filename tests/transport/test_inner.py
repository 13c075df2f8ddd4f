"""Kernels that only kernels call: Python can call them too, and nothing of them is kept on its own."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from skinrender.transport.inner import inner
from skinrender.transport.kernel_cache import cached, is_on_disk

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


@inner(no_cpython_wrapper=True, error_model="numpy", forceinline=True)
def ratio(x, y):
    return x / y


@inner(no_cpython_wrapper=True, error_model="numpy")
def mean_ratio(x, y):
    total = 0.0
    for k in range(len(x)):
        total += ratio(x[k], y)
    return total / len(x)


def test_kernels_take_them_in():
    outer = numba.njit(lambda x, y: mean_ratio(x, y) + ratio(y, y))
    assert outer(np.arange(4.0), 2.0) == 1.75
    assert outer(np.arange(4, dtype=np.float32), np.float32(2.0)) == 1.75  # another type compiles them anew


def test_python_calls_them_as_it_calls_functions():
    assert mean_ratio(np.arange(4.0), 2.0) == 0.75
    assert ratio(1.0, 0.0) == np.inf


def test_a_caller_of_them_is_kept_without_them(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))

    @cached(numba.njit(cache=True))
    def outer(x):
        return ratio(x, 4.0)

    assert not is_on_disk(outer)
    assert outer(2.0) == 0.5
    assert is_on_disk(outer)
    assert {path.name.split("-")[0].rsplit(".")[-1] for path in tmp_path.rglob("*.nb?")} == {"outer"}
