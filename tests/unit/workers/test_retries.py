"""Retries: ever more rarely, until it works."""

from hypothesis import given
from hypothesis import strategies as st

from tests.support.contexts import Clock
from tidemap.workers.retries import MAX_RETRY_S, Retries


def test_what_never_failed_is_always_tried() -> None:
    retries = Retries(10.0, Clock())
    retries.failed(1)
    assert (retries.due(2), retries.fails(2)) == (True, False)
    assert (retries.due(1), retries.fails(1)) == (False, True)


@given(st.integers(1, 100), st.floats(0.1, 100))
def test_each_failure_doubles_the_rest_up_to_an_hour(failures: int, first_s: float) -> None:
    clock = Clock(0.0)
    retries = Retries(first_s, clock)
    for n in range(failures):
        retries.failed(1)
        rest = min(MAX_RETRY_S, first_s * 2**n)
        began, clock.now = clock.now, clock.now + 0.999 * rest
        assert not retries.due(1)
        clock.now = began + 1.001 * rest
        assert retries.due(1)
        assert retries.fails(1)
    retries.worked(1)
    assert retries.due(1)
    retries.failed(1)
    clock.now += 1.001 * min(MAX_RETRY_S, first_s)
    assert retries.due(1), "it begins anew"


def test_what_works_may_work_again() -> None:
    retries = Retries(1.0, Clock())
    retries.worked(1)
    assert (retries.due(1), retries.fails(1)) == (True, False)
