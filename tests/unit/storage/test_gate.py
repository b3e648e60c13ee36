"""The gate: open it is in nobody's way, shut it lets nobody in, and nobody waits for himself."""

from concurrent.futures import ThreadPoolExecutor
from threading import Event, Thread

import pytest

from tests.support.waiting import WAIT_S, until
from tidemap.errors import ShuttingDownError
from tidemap.storage.gate import Gate


def test_many_are_inside_at_once_and_it_shuts_when_they_have_left() -> None:
    gate, leave, inside = Gate(), Event(), []

    def read() -> None:
        with gate.inside():
            inside.append(1)
            assert leave.wait(WAIT_S)

    with ThreadPoolExecutor(4) as pool:
        reading = [pool.submit(read) for _ in range(4)]
        until(lambda: len(inside) == 4)
        with gate.shut(0.01) as empty:
            assert not empty
        leave.set()
        with gate.shut(WAIT_S) as empty:
            assert empty
        for each in reading:
            each.result()


def test_nobody_comes_in_while_it_is_shut() -> None:
    gate, came = Gate(), Event()

    def read() -> None:
        with gate.inside():
            came.set()

    with gate.shut(WAIT_S) as empty:
        assert empty
        reader = Thread(target=read)
        reader.start()
        assert not came.wait(0.1)
    assert came.wait(WAIT_S)
    reader.join()


def test_who_is_inside_comes_in_again_while_others_wait_for_him() -> None:
    gate, inside, again = Gate(), Event(), Event()

    def read() -> None:
        with gate.inside():
            inside.set()
            until(lambda: gate._shut)
            with gate.inside():
                again.set()

    reader = Thread(target=read)
    reader.start()
    assert inside.wait(WAIT_S)
    with gate.shut(WAIT_S) as empty:
        assert empty
    assert again.is_set()
    reader.join()


def test_who_fails_inside_has_left() -> None:
    gate = Gate()
    with pytest.raises(ArithmeticError), gate.inside():
        raise ArithmeticError
    with gate.shut(0) as empty:
        assert empty


def test_closed_it_lets_nobody_in() -> None:
    gate = Gate()
    gate.close()
    with pytest.raises(ShuttingDownError), gate.inside():
        raise AssertionError("this came in")
