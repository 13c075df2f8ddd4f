"""Work beside other work: what it gives, what it raises, and that nobody has to wait for it."""

import threading

import pytest

from skinrender.engine.beside import beside


def test_result_comes_when_it_is_there():
    begin = threading.Event()

    def work() -> int:
        begin.wait(10)
        return 7

    result = beside(work)
    begin.set()
    assert result() == 7 and result() == 7


def test_what_it_raises_is_raised_where_it_is_waited_for():
    result = beside(lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        result()


def test_its_thread_does_not_keep_the_program():
    inside, end = threading.Event(), threading.Event()

    def work() -> bool:
        inside.set()
        end.wait(10)
        return threading.current_thread().daemon

    result = beside(work)
    assert inside.wait(10)
    end.set()
    assert result()
