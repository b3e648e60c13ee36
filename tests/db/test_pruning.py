"""What is pruned, when, and that nothing else goes with it."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from tests.support.contexts import Clock, Serial, compact_now, history_of, make_location, post_rows, refit
from tidemap.errors import ShuttingDownError
from tidemap.services import pruning
from tidemap.services.context import Context
from tidemap.services.jobs import cancel_job, claim_job, list_jobs, request_update, run_job
from tidemap.services.locations import LocationChanges, change_location, find_location, get_location
from tidemap.services.pruning import KEPT_JOBS, prune
from tidemap.services.state import StateQuery, state_at
from tidemap.services.update import UpdateRequest
from tidemap.services.verify import verify
from tidemap.settings import DAY_S, WEEK_S
from tidemap.storage.tables import observation


def post(ctx: Context, number: int, name: str = "lab") -> bool:
    """Post under a key; whether that was a repeat."""
    rows = [(60.0 * number + cell, cell, number % 2) for cell in range(3)]
    return post_rows(ctx, name, rows, idempotency_key=f"k{number}").duplicate


def log_of(ctx: Context, name: str = "lab") -> list[int]:
    with ctx.store.read() as work:
        location_id = work.locations.get(name).id
        query = observation.select().where(observation.c.location_id == location_id).order_by(observation.c.id)
        return [row.id for row in work.jobs._connection.execute(query)]


def test_keys_stay_a_week_and_go_with_nothing_else(ctx: Context, clock: Clock) -> None:
    for name in ("lab", "attic"):
        make_location(ctx, name, (4, 4))
    for number in range(6):
        post(ctx, number)
        clock.now += DAY_S
    post(ctx, 0, "attic")
    compact_now(ctx)
    clock.now += 2 * DAY_S - 1
    before = history_of(ctx, "lab", 0, 0, 9).states()
    refit(ctx, "lab", estimator="static")
    facts, view = get_location(ctx, "lab"), state_at(ctx, "lab", StateQuery(0.0))
    assert prune(ctx) == 1
    assert log_of(ctx) == [2, 3, 4, 5, 6]
    assert [post(ctx, number) for number in (1, 5)] == [True, True]
    clock.now += DAY_S + 1
    assert prune(ctx) == 1
    assert prune(ctx) == 0
    assert log_of(ctx) == [3, 4, 5, 6]
    assert log_of(ctx, "attic") == [1]
    np.testing.assert_array_equal(history_of(ctx, "lab", 0, 0, 9).states(), before)
    assert get_location(ctx, "lab") == facts
    np.testing.assert_array_equal(state_at(ctx, "lab", StateQuery(0.0)).probability, view.probability)
    verify(ctx.settings.url, lambda finding: pytest.fail(str(finding)))
    clock.now += 99 * DAY_S
    assert prune(ctx) == 4
    verify(ctx.settings.url, lambda finding: pytest.fail(str(finding)))
    post(ctx, 7)
    assert log_of(ctx) == [7]
    verify(ctx.settings.url, lambda finding: pytest.fail(str(finding)))


def test_what_is_not_compacted_stays_however_old(ctx: Context, clock: Clock) -> None:
    make_location(ctx, "lab", (4, 4))
    post(ctx, 0)
    compact_now(ctx)
    post(ctx, 1)
    clock.now += 99 * DAY_S
    assert prune(ctx) == 1
    assert log_of(ctx) == [2]
    assert history_of(ctx, "lab", 0, 0, 2).states()[0].tolist() == [0, 1]


def test_small_transactions_until_nothing_is_left(ctx: Context, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pruning, "ROWS", 4)
    make_location(ctx, "lab", (4, 4))
    for number in range(10):
        post(ctx, number)
    compact_now(ctx)
    clock.now += WEEK_S + 1
    steps = iter(range(2))

    def check() -> None:
        if next(steps, None) is None:
            raise ShuttingDownError

    with pytest.raises(ShuttingDownError):
        prune(ctx, check)
    assert log_of(ctx) == [9, 10]
    assert prune(ctx) == 2


def test_finished_jobs_go_but_for_the_last(ctx: Context, clock: Clock) -> None:
    for name in ("lab", "attic"):
        make_location(ctx, name, (4, 4))
    jobs = [request_update(ctx, "lab", UpdateRequest()).id for _ in range(KEPT_JOBS + 5)]
    quiet = request_update(ctx, "attic", UpdateRequest()).id
    for job in (*jobs[:-1], quiet):
        cancel_job(ctx, job)
        clock.now += 1
    clock.now += 31 * DAY_S
    assert prune(ctx) == 4
    assert [job.id for job in list_jobs(ctx, None, 99)] == [quiet, *reversed(jobs[4:])]
    verify(ctx.settings.url, lambda finding: pytest.fail(str(finding)))


def test_a_location_renamed_before_and_during_its_update_gets_it(ctx: Context) -> None:
    make_location(ctx, "lab", (80, 40))
    post_rows(ctx, "lab", [(60.0 * n, cell, n % 2) for n in range(4) for cell in (7, 1500, 3000)])
    job = request_update(ctx, "lab", UpdateRequest(estimator="static"))
    claimed = claim_job(ctx, frozenset())
    assert claimed is not None
    location_id = claimed.location_id
    change_location(ctx, "lab", LocationChanges(name="attic"))

    class Renaming(Serial):
        def map(self, run: Callable[[Context, Any], Any], items: Iterable[Any]) -> Iterable[Any]:
            for item in items:
                name = find_by_id(ctx, location_id)
                change_location(ctx, name, LocationChanges(name=f"room-{item.chunk}"))
                yield run(self.ctx, item)

    run_job(ctx, claimed, Renaming(ctx))
    (done,) = list_jobs(ctx, None, 9)
    assert (done.id, done.state, done.location) == (job.id, "done", "room-3")
    assert find_location(ctx, "room-3").revision == 1


def find_by_id(ctx: Context, location_id: int) -> str:
    with ctx.store.read() as work:
        return work.locations.by_id(location_id).name
