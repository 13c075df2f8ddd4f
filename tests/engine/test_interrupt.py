"""What a signal becomes."""

from __future__ import annotations

import signal

import pytest

from skinrender.engine.interrupt import Interrupted, stopped_at_once


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_error_that_comes_of_a_signal_is_an_interruption(number):
    before = signal.getsignal(number)
    with pytest.raises(Interrupted), stopped_at_once():
        try:
            signal.raise_signal(number)
        except Interrupted as error:
            raise ImportError("a compiled module, imported just then, says that it failed") from error
    assert signal.getsignal(number) is before


def test_other_errors_stay_what_they_are():
    with pytest.raises(ZeroDivisionError), stopped_at_once():
        raise ZeroDivisionError
