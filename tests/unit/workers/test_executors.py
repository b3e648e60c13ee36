"""Executors: results in order, errors to the caller, and an end that is told from a failure."""

import time
from collections.abc import Iterator
from threading import Event, Thread, current_thread

import pytest

from tests.support.waiting import WAIT_S
from tidemap.errors import ShuttingDownError
from tidemap.services.context import Context
from tidemap.workers.executors import LocalExecutor


def negate(_: Context, n: int) -> int:
    return -n


@pytest.fixture
def executor(ctx: Context) -> Iterator[LocalExecutor]:
    """Two threads."""
    made = LocalExecutor(ctx, 2)
    yield made
    made.close()


def test_results_come_in_the_order_of_the_items(executor: LocalExecutor) -> None:
    def task(_: Context, n: int) -> int:
        time.sleep(0.001 * (5 - n % 5))
        return n * n

    assert list(executor.map(task, range(20))) == [n * n for n in range(20)]


def test_tasks_run_at_the_same_time_in_threads_of_its_own(executor: LocalExecutor) -> None:
    begun = [Event(), Event()]

    def meet(_: Context, n: int) -> str:
        begun[n].set()
        assert begun[1 - n].wait(WAIT_S)
        return current_thread().name

    assert all(name.startswith("tidemap-update") for name in executor.map(meet, range(2)))


@pytest.mark.parametrize("error", [ValueError("bad"), RuntimeError("bad")])
def test_an_error_of_a_task_is_the_callers(executor: LocalExecutor, error: Exception) -> None:
    def task(_: Context, n: int) -> int:
        if n == 3:
            raise error
        return n

    results = executor.map(task, range(6))
    with pytest.raises(type(error), match="bad"):
        list(results)
    assert list(executor.map(negate, [-1])) == [1]


def test_closing_lets_what_runs_end_and_says_so_for_the_rest(ctx: Context) -> None:
    executor, begun, go_on, ended = LocalExecutor(ctx, 1), Event(), Event(), []

    def task(_: Context, n: int) -> None:
        begun.set()
        go_on.wait(WAIT_S)
        ended.append(n)

    failed: list[BaseException] = []

    def run() -> None:
        try:
            list(executor.map(task, range(5)))
        except BaseException as error:
            failed.append(error)

    running = Thread(target=run)
    running.start()
    assert begun.wait(WAIT_S)
    closing = Thread(target=executor.close)
    closing.start()
    go_on.set()
    for thread in (closing, running):
        thread.join(WAIT_S)
    assert ended == list(range(len(ended)))
    assert [type(error) for error in failed] == [ShuttingDownError] or len(ended) == 5
    with pytest.raises(ShuttingDownError):
        list(executor.map(negate, [1]))


def test_who_checks_hears_that_nothing_more_is_to_be_started(executor: LocalExecutor) -> None:
    executor.check()
    executor.request_stop()
    with pytest.raises(ShuttingDownError):
        executor.check()
