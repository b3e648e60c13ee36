"""A worker: rounds now and then and when it is woken, through every error, until it is told to end."""

import logging
import time
from threading import Event

import pytest

from tests.support.contexts import make_location
from tests.support.waiting import WAIT_S, until
from tidemap.errors import LocationNotFoundError, QueueFullError
from tidemap.services.context import Context
from tidemap.services.locations import find_location
from tidemap.workers.worker import Worker

LONG_S = 3600.0


def test_it_does_a_round_at_the_start_then_one_each_time_it_is_woken() -> None:
    rounds: list[int] = []
    worker = Worker("counter", LONG_S, lambda: rounds.append(1))
    with worker.running():
        for expected in (1, 2, 3):
            until(lambda expected=expected: len(rounds) == expected)  # type: ignore[misc]
            worker.wake()
    assert not worker.alive()


def test_it_does_rounds_without_being_woken() -> None:
    rounds: list[int] = []
    with Worker("counter", 0.001, lambda: rounds.append(1)).running():
        until(lambda: len(rounds) > 3)


@pytest.mark.parametrize(
    ("error", "said"), [(QueueFullError(), ""), (ArithmeticError("odd"), "the counter failed and goes on")]
)
def test_an_error_ends_a_round_alone(error: Exception, said: str, caplog: pytest.LogCaptureFixture) -> None:
    rounds: list[int] = []

    def fail() -> None:
        rounds.append(1)
        raise error

    caplog.set_level(logging.INFO)
    with Worker("counter", 0.001, fail).running():
        until(lambda: len(rounds) > 3)
    assert said in caplog.text
    assert bool(said) == bool(caplog.text)


def test_told_to_end_it_leaves_the_round_at_its_next_check() -> None:
    begun = Event()

    def work() -> None:
        begun.set()
        while True:
            worker.check()
            time.sleep(0.001)

    worker = Worker("sleeper", LONG_S, work)
    with worker.running():
        assert begun.wait(WAIT_S)
    assert not worker.alive()


@pytest.mark.parametrize("error", [LocationNotFoundError("attic"), ArithmeticError("odd")])
def test_what_keeps_it_from_one_location_keeps_it_from_no_other(
    ctx: Context, error: Exception, caplog: pytest.LogCaptureFixture
) -> None:
    cared = []
    for name in ("attic", "door"):
        make_location(ctx, name)

    def care(location: object) -> None:
        cared.append(location)
        if len(cared) == 1:
            raise error

    locations = [find_location(ctx, name) for name in ("attic", "door")]
    Worker("keeper", LONG_S, lambda: None).for_each(locations, care)
    assert cared == locations
    assert "location attic" in caplog.text
    with pytest.raises(QueueFullError):
        Worker("keeper", LONG_S, lambda: None).for_each(locations, lambda _: (_ for _ in ()).throw(QueueFullError()))
