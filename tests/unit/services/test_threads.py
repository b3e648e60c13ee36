"""One context serves many threads at once: posts, questions, updates and compactions, all at the same time."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from tests.support.contexts import compact_now, history_of, make_location, opened, post_rows, refit
from tidemap.errors import DomainError
from tidemap.history.history import UNOBSERVED
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.detect import DetectQuery, detect
from tidemap.services.locations import get_location, list_locations
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.services.series import SeriesQuery, series
from tidemap.services.state import StateQuery, state_at

Job = tuple[Callable[[Context, int], None], int]
CELLS = (3, 900, 1030, 1599)


def rows_of(n: int) -> list[tuple[float, int, int]]:
    """One look; the state of a cell follows from the time alone."""
    return [(60.0 * n, cell, (n // 7 + cell) % 2) for cell in CELLS]


@pytest.mark.parametrize("cache_bytes", [256 * 2**20, 0])
def test_answers_are_right_while_everything_happens_at_once(database_url: str, cache_bytes: int) -> None:
    with opened(database_url, history_cache_bytes=cache_bytes, spectrum_cache_bytes=cache_bytes) as ctx:
        make_location(ctx, "lab", (40, 40))
        for n in range(20):
            post_rows(ctx, "lab", rows_of(n))
        refit(ctx, "lab", estimator="fft", order=3)
        jobs: list[Job] = [(act, n) for n in range(20, 50) for act in (post, ask, ask)]
        jobs += [(update, n) for n in range(3)] + [(compaction, n) for n in range(6)]
        np.random.default_rng(1).shuffle(jobs)
        with ThreadPoolExecutor(8) as pool:
            list(pool.map(lambda job: job[0](ctx, job[1]), jobs))
        for chunk in range(2):
            assert_history(ctx, chunk, 50, complete=True)
        assert get_location(ctx, "lab").measurements == 50 * len(CELLS)
        assert ctx.store._reader.pool.checkedout() == 0  # type: ignore[attr-defined]


def post(ctx: Context, n: int) -> None:
    post_rows(ctx, "lab", rows_of(n))


def compaction(ctx: Context, _: int) -> None:
    compact_now(ctx, "lab")


def update(ctx: Context, n: int) -> None:
    try:
        refit(ctx, "lab", estimator="fft", order=1 + n)
    except DomainError:
        """Two updates took the same number; one of them goes on."""


def ask(ctx: Context, n: int) -> None:
    view = state_at(ctx, "lab", StateQuery(60.0 * n, observed=True, order=n % 4))
    assert view.cell.tolist() == list(CELLS)
    assert not np.isnan(view.probability).any()
    assert_observed(view.observed, view.observed_time)
    prediction = predict_at(ctx, "lab", PredictQuery([0.0, 60.0 * n], list(CELLS)))
    assert prediction.probability.shape == (4, 2)
    line = series(ctx, "lab", SeriesQuery(1030))
    times = line.time[line.observed != UNOBSERVED]
    assert line.observed[line.observed != UNOBSERVED].tolist() == [(int(t // 60) // 7 + 1030) % 2 for t in times]
    assert_history(ctx, n % 2, 50, complete=False)
    detect(ctx, "lab", DetectQuery(0.0, 3000.0))
    list_events(ctx, EventQuery())
    list_locations(ctx)


def assert_observed(observed: Any, at: Any) -> None:
    for cell, state, time in zip(CELLS, observed.tolist(), at.tolist(), strict=True):
        assert state == (int(time // 60) // 7 + cell) % 2


def assert_history(ctx: Context, chunk: int, stop: int, complete: bool) -> None:
    """What is there is right; and all is there where that is said."""
    states = history_of(ctx, "lab", chunk, 0, stop).states()
    for cell in CELLS:
        if cell // 1024 == chunk:
            seen = states[cell % 1024]
            known = np.flatnonzero(seen != UNOBSERVED)
            assert seen[known].tolist() == [(n // 7 + cell) % 2 for n in known.tolist()]
            assert len(known) == stop if complete else len(known) >= 20
    assert (states != UNOBSERVED).any(axis=1).sum() == sum(cell // 1024 == chunk for cell in CELLS)
