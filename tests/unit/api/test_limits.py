"""Rates of requests, on a clock moved by hand."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tidemap.api.limits import BELIEVED_S, Lately, Rate, Senders
from tidemap.errors import RateLimitError
from tidemap.services.keys import Claim, Principal


class Clock:
    now = 1000.0

    def __call__(self) -> float:
        return self.now


def taken(rate: Rate, name: str = "a") -> bool:
    try:
        rate.take(name)
    except RateLimitError:
        return False
    return True


def test_a_burst_at_once_and_then_so_many_a_second() -> None:
    clock = Clock()
    rate = Rate(per_s=2, burst=5, clock=clock)
    assert [taken(rate) for _ in range(7)] == [True] * 5 + [False] * 2
    clock.now += 0.5
    assert [taken(rate) for _ in range(2)] == [True, False]
    clock.now += 1
    assert [taken(rate) for _ in range(3)] == [True, True, False]
    clock.now += 1000
    assert [taken(rate) for _ in range(6)] == [True] * 5 + [False]


def test_names_do_not_share() -> None:
    rate = Rate(per_s=1, burst=1, clock=Clock())
    assert [taken(rate, name) for name in "aabba"] == [True, False, True, False, False]


def test_it_says_after_how_many_whole_seconds_there_is_one_again() -> None:
    clock = Clock()
    rate = Rate(per_s=0.4, burst=1, clock=clock)
    rate.take("a")
    with pytest.raises(RateLimitError, match="again in 3 s") as caught:
        rate.take("a")
    assert caught.value.retry_after_s == 3
    clock.now += 3
    rate.take("a")


@given(
    st.floats(0.1, 100),
    st.integers(1, 20),
    st.lists(st.floats(0, 2), min_size=1, max_size=60),
)
def test_never_more_than_the_burst_and_what_time_has_brought(per_s: float, burst: int, pauses: list[float]) -> None:
    clock, passed, began = Clock(), 0, Clock.now
    rate = Rate(per_s, burst, clock)
    for pause in pauses:
        clock.now += pause
        passed += taken(rate)
        assert passed <= burst + (clock.now - began) * per_s + 1e-6


@given(st.floats(0.1, 100), st.integers(1, 20), st.lists(st.floats(0, 2), max_size=60))
def test_a_request_that_waits_as_long_as_asked_is_taken(per_s: float, burst: int, pauses: list[float]) -> None:
    clock = Clock()
    rate = Rate(per_s, burst, clock)
    for pause in pauses:
        clock.now += pause
        try:
            rate.take("a")
        except RateLimitError as error:
            clock.now += error.retry_after_s
            rate.take("a")


def test_zero_is_no_limit() -> None:
    rate = Rate(per_s=0, burst=1, clock=Clock())
    assert all(taken(rate) for _ in range(100))


def test_only_the_last_names_are_remembered() -> None:
    rate = Rate(per_s=1, burst=1, clock=Clock(), most=3)
    for name in "abcd":
        rate.take(name)
    assert [taken(rate, name) for name in "dcba"] == [False, False, False, True]


def test_the_secrets_that_were_right_last_are_known() -> None:
    lately = Lately(most=2)
    for secret in ("a", "b", "a", "c"):
        lately.add(secret)
    assert [secret in lately for secret in "abc"] == [True, False, True]


def test_a_sender_is_known_for_a_while_and_no_more_than_so_many_are() -> None:
    clock = Clock()
    senders = Senders(clock, most=2)
    claims = [Claim(Principal(name, "robot", 1), name.encode()) for name in "abc"]
    for claim in claims:
        senders.add(claim)
    assert [senders.get(claim.digest) for claim in claims] == [None, *claims[1:]]
    senders.forget(claims[1])
    assert senders.get(claims[1].digest) is None
    clock.now += BELIEVED_S
    assert senders.get(claims[2].digest) is None
