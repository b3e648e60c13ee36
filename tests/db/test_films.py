"""What a film says was last seen is what a search through history finds, whatever comes in meanwhile."""

from concurrent.futures import ThreadPoolExecutor
from itertools import count
from threading import Event, Semaphore
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.db.test_given import BEGIN, CELLS, MINUTE, SHAPE, STEP, do
from tests.support.contexts import make_location, opened, post_rows, refit
from tests.support.waiting import WAIT_S
from tidemap.history.history import NEVER
from tidemap.services import films
from tidemap.services.context import MAX_MAKING, Context, Seen
from tidemap.services.films import film_key, make_film, seen_at
from tidemap.services.history import read_backwards
from tidemap.services.locations import find_location
from tidemap.services.readings import last_seen
from tidemap.services.spectra import fitted

NAMES = count()
KNOWN = np.array(sorted(CELLS))


def look(ctx: Context, name: str, time: float) -> Seen:
    """What was last seen, from a film that is at hand or made for it."""
    return seen_at(ctx, find_location(ctx, name), time) or make_film(ctx, fitted(ctx, name), time)


def compare(ctx: Context, name: str) -> None:
    location = find_location(ctx, name)
    # Nothing may be left of what was measured.
    latest = BEGIN if location.last_time is None else location.last_time
    # The latest first and last: what was read between is put over what was seen.
    for time in (latest, BEGIN - 50 * MINUTE, BEGIN + 100 * MINUTE, latest, latest + 1e6):
        seen = look(ctx, name, time)
        found = last_seen(ctx, location, int(location.base.sample(time)), KNOWN)
        assert seen.sample[KNOWN].tolist() == found.sample.tolist()
        assert seen.state[KNOWN].tolist() == found.state.tolist()


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(steps=st.lists(STEP, min_size=3, max_size=9), combine=st.sampled_from(["latest", "any", "majority"]))
def test_a_film_is_what_history_says(ctx: Context, steps: list[tuple[str, Any]], combine: str) -> None:
    name = f"lab-{next(NAMES)}"
    make_location(ctx, name, SHAPE, estimator="static", combine=combine)
    post_rows(ctx, name, [(BEGIN, cell, cell % 2) for cell in CELLS])
    refit(ctx, name)
    compare(ctx, name)
    for step, what in steps:
        do(ctx, name, step, what)
        compare(ctx, name)


def test_a_post_is_followed_without_reading_any_history(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    make_location(ctx, "lab", SHAPE, estimator="static")
    post_rows(ctx, "lab", [(BEGIN, cell, 0) for cell in CELLS])
    refit(ctx, "lab")
    look(ctx, "lab", BEGIN)
    monkeypatch.setattr(films, "read_backwards", None)
    for number in range(1, 400, 7):  # through several windows
        post_rows(ctx, "lab", [(BEGIN + number * MINUTE, 5, number % 2)])
        seen = seen_at(ctx, find_location(ctx, "lab"), BEGIN + number * MINUTE)
        assert seen is not None
        assert (seen.state[5], seen.state[0]) == (number % 2, 0)
        assert seen.sample[0] == seen.sample[5] - number


def test_moments_of_one_window_share_a_film_and_it_can_be_given_up(database_url: str) -> None:
    with opened(database_url) as ctx:
        make_location(ctx, "lab", SHAPE, estimator="static")
        post_rows(ctx, "lab", [(BEGIN + n * 600 * MINUTE, 5, n % 2) for n in range(6)])
        refit(ctx, "lab")
        location = find_location(ctx, "lab")
        keys = [film_key(ctx, location, BEGIN + minutes * MINUTE) for minutes in (0, 1, 1000, 3000, 4000)]
        assert keys[0] == keys[1] != keys[2]
        assert keys[3] == keys[4] == "now"
        with pytest.raises(InterruptedError):
            make_film(ctx, fitted(ctx, "lab"), BEGIN, _interrupt)
        assert seen_at(ctx, location, BEGIN) is None


def test_tabs_that_ask_at_once_share_what_is_made(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    make_location(ctx, "lab", SHAPE, estimator="static")
    post_rows(ctx, "lab", [(BEGIN, 5, 1)])
    refit(ctx, "lab")
    model, read, begun, go_on = fitted(ctx, "lab"), read_backwards, Semaphore(0), Event()

    def slowly(*asked: Any) -> Any:
        begun.release()
        assert go_on.wait(WAIT_S)
        return read(*asked)

    monkeypatch.setattr(films, "read_backwards", slowly)
    with ThreadPoolExecutor(6) as tabs:
        looks = [tabs.submit(make_film, ctx, model, BEGIN) for _ in range(6)]
        for _ in range(MAX_MAKING):
            assert begun.acquire(timeout=WAIT_S)
        with pytest.raises(InterruptedError):
            make_film(ctx, model, BEGIN, _interrupt)  # nobody waits for it any more
        go_on.set()
        assert {look.result(WAIT_S).state[5] for look in looks} == {1}
    chunks_read = MAX_MAKING * model.location.n_chunks
    others = sum(iter(lambda: begun.acquire(blocking=False), False))
    assert MAX_MAKING + others == chunks_read


def _interrupt(_: float) -> None:
    raise InterruptedError


def test_a_film_that_is_too_large_to_be_kept_is_made_each_time(database_url: str) -> None:
    with opened(database_url, history_cache_bytes=0) as ctx:
        make_location(ctx, "lab", SHAPE, estimator="static")
        post_rows(ctx, "lab", [(BEGIN, 5, 1)])
        refit(ctx, "lab")
        seen = make_film(ctx, fitted(ctx, "lab"), BEGIN)
        assert seen.state[5] == 1
        assert seen.sample[6] == NEVER
        assert seen_at(ctx, find_location(ctx, "lab"), BEGIN) is None
