"""The compactor: logs stay short whatever the updater does, old rows go, and it ends at once."""

import math
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from threading import Event
from typing import Any

import numpy as np
import pytest
from sqlalchemy import func, select, update

from tests.support.contexts import (
    NOW,
    Clock,
    at_work,
    compact_now,
    elected,
    history_of,
    make_location,
    opened,
    post_rows,
    post_states,
)
from tests.support.waiting import WAIT_S, until
from tidemap.errors import ShuttingDownError
from tidemap.history.history import UNOBSERVED
from tidemap.history.segment import merge
from tidemap.services import compaction
from tidemap.services.context import Context
from tidemap.services.jobs import request_update
from tidemap.services.locations import LocationChanges, change_location, find_location
from tidemap.services.update import UpdateRequest
from tidemap.services.update_task import run_task
from tidemap.storage.records import LocationRecord
from tidemap.storage.tables import history, observation
from tidemap.storage.work import Work
from tidemap.workers import compactor as compactor_module
from tidemap.workers.compactor import COMPACT_POSTS, Compactor
from tidemap.workers.election import LeaderElection
from tidemap.workers.updater import Updater


@contextmanager
def working(ctx: Context) -> Iterator[Compactor]:
    """A compactor at work."""
    with elected(ctx) as election, at_work(Compactor(ctx, election)) as compactor:
        yield compactor


def compacted(ctx: Context, name: str = "door") -> int:
    return find_location(ctx, name).compacted_seq


def post_many(ctx: Context, count: int) -> None:
    for _ in range(count):
        post_states(ctx, "door", [0.0], [1])


def test_a_long_log_is_compacted_without_anybody_asking(lively: Context) -> None:
    make_location(lively, "door")
    with working(lively):
        post_many(lively, COMPACT_POSTS + 1)
        until(lambda: compacted(lively) >= COMPACT_POSTS)
    assert find_location(lively, "door").revision == 0


def test_a_few_large_posts_are_compacted_too(lively: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compactor_module, "COMPACT_MEASUREMENTS", 40)
    make_location(lively, "door")
    make_location(lively, "gate")
    with working(lively):
        post_states(lively, "gate", 60.0 * np.arange(39), np.ones(39))
        post_states(lively, "door", 60.0 * np.arange(20), np.ones(20))
        post_states(lively, "door", 60.0 * np.arange(20, 40), np.ones(20))
        until(lambda: compacted(lively) == 2)
    assert compacted(lively, "gate") == 0


def test_many_measurements_wake_it(database_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compactor_module, "COMPACT_MEASUREMENTS", 40)
    with opened(database_url, updater=True, updater_interval_s=3600.0) as ctx:
        make_location(ctx, "door")
        with working(ctx):
            for n in range(4):
                post_states(ctx, "door", 60.0 * np.arange(20 * n, 20 * n + 20), np.ones(20))
            until(lambda: compacted(ctx) >= 2)


def test_posts_are_slowed_down_while_it_is_late_and_no_longer(lively: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compactor_module, "LATE_MEASUREMENTS", 1000)
    go_on = Event()
    monkeypatch.setattr(compactor_module, "compact", lambda *_: go_on.wait(WAIT_S))
    make_location(lively, "door")
    writer = lively.store._writer
    post_many(lively, COMPACT_POSTS)
    with working(lively):
        for n in range(2):
            post_states(lively, "door", np.arange(1000.0 * n, 1000.0 * n + 1000), np.ones(1000))
        until(lambda: writer.rest_s == compactor_module.SLOWEST_S)
        began = time.monotonic()
        for _ in range(2):
            post_states(lively, "door", [0.0], [1])
        assert time.monotonic() - began >= compactor_module.SLOWEST_S
        monkeypatch.setattr(compactor_module, "compact", compaction.compact)
        go_on.set()
        until(lambda: compacted(lively) >= COMPACT_POSTS)
        until(lambda: not lively_rest(lively))


def test_many_short_logs_slow_nobody_down(lively: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compactor_module, "LATE_MEASUREMENTS", 10)
    for name in ("door", "gate", "attic"):
        make_location(lively, name)
        post_states(lively, name, 60.0 * np.arange(9), np.ones(9))
    with working(lively) as compactor:
        looked = Event()
        monkeypatch.setattr(compactor, "_prune", lambda *_: looked.set())
        assert looked.wait(WAIT_S)
        assert lively_rest(lively) == 0


def lively_rest(ctx: Context) -> float:
    """How long the writer rests after a post."""
    post_states(ctx, "door", [0.0], [1])
    return ctx.store._writer.rest_s


def damage(ctx: Context, chunk: int) -> bytes:
    """Make a stored segment of the lab unreadable; what it was."""
    mine = (history.c.location_id == find_location(ctx, "lab").id) & (history.c.chunk == chunk)

    def run(work: Work) -> bytes:
        connection = work.jobs._connection
        sound = bytes(connection.execute(select(history.c.payload).where(mine)).scalar_one())
        connection.execute(update(history).where(mine).values(payload=sound[:-1]))
        return sound

    return ctx.store.write(run)


def make_hopeless(ctx: Context) -> bytes:
    """A lab whose history is damaged, and what was put aside for it too: it cannot be compacted. What that was."""
    make_location(ctx, "lab", (4, 4))
    for damaged in (0, -1):
        post_rows(ctx, "lab", [(0.0, 3, 1)])
        compact_now(ctx)
        sound = damage(ctx, damaged)
    for _ in range(COMPACT_POSTS):
        post_rows(ctx, "lab", [(60.0, 3, 1)])
    return sound


def test_a_location_that_cannot_be_compacted_is_tried_ever_more_rarely_and_nobody_waits_for_it(
    lively: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[str] = []

    def compact(ctx: Context, location: LocationRecord, check: Callable[[], None]) -> None:
        tried.append(location.name)
        compaction.compact(ctx, location, check)

    monkeypatch.setattr(compactor_module, "compact", compact)
    monkeypatch.setattr(compactor_module, "LATE_MEASUREMENTS", 10)
    monkeypatch.setattr(compactor_module, "FAILED_S", 0.5)
    aside = make_hopeless(lively)
    make_location(lively, "door")
    began = time.monotonic()
    with working(lively) as compactor:
        until(lambda: compactor._retries.fails(find_location(lively, "lab").id))
        until(lambda: not lively_rest(lively))
        post_many(lively, COMPACT_POSTS)
        until(lambda: compacted(lively) >= COMPACT_POSTS)
        time.sleep(0.5)
        assert not lively_rest(lively)
        # At 0, 0.5, 1.5, 3.5, … instead of fifty times a second.
        assert tried.count("lab") <= 2 + math.log2(1 + (time.monotonic() - began) / 0.5)
        mine = history.c.chunk == -1
        lively.store.write(
            lambda work: work.jobs._connection.execute(update(history).where(mine).values(payload=aside))
        )
        until(lambda: compacted(lively, "lab") == COMPACT_POSTS + 2)
        until(lambda: not compactor._retries.fails(find_location(lively, "lab").id))


def test_without_a_leader_nobody_waits_long_for_a_location_that_is_not_compacted(
    lively: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compactor_module, "LATE_MEASUREMENTS", 10)
    monkeypatch.setattr(compactor_module, "STALLED_S", 0.5)
    make_location(lively, "door")
    post_many(lively, COMPACT_POSTS)
    with elected(lively) as election:
        until(lambda: election.term is not None)
        other = LeaderElection(lively)
        compactor = Compactor(lively, other)
        compactor.start()
        try:
            until(lambda: compactor._waiting >= COMPACT_POSTS)
            until(lambda: compactor._waiting == 0)
            assert compacted(lively) == 0
            compact_now(lively, "door")
            post_many(lively, COMPACT_POSTS)
            until(lambda: compactor._waiting >= COMPACT_POSTS)
        finally:
            compactor.stop()


def test_it_works_while_an_update_runs(lively: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    from tidemap.services import update

    begun, go_on = Event(), Event()
    fit = run_task

    def slow(*arguments: Any) -> Any:
        begun.set()
        assert go_on.wait(WAIT_S)
        return fit(*arguments)

    monkeypatch.setattr(update, "run_task", slow)
    make_location(lively, "door", estimator="static")
    post_many(lively, 1)
    with working(lively) as compactor:
        updater = Updater(lively, compactor._election)
        updater.start()
        try:
            request_update(lively, "door", UpdateRequest())
            assert begun.wait(WAIT_S)
            post_many(lively, COMPACT_POSTS)
            until(lambda: compacted(lively) >= COMPACT_POSTS)
            assert find_location(lively, "door").revision == 0
            go_on.set()
            until(lambda: find_location(lively, "door").revision == 1)
        finally:
            go_on.set()
            updater.stop()


def test_told_to_stop_in_a_round_it_stores_nothing_of_that_and_loses_nothing(
    lively: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, merged = Event(), []

    def slow(*arguments: Any) -> Any:
        merged.append(1)
        begun.set()
        time.sleep(0.2)
        return merge(*arguments)

    monkeypatch.setattr(compaction, "merge", slow)
    make_location(lively, "lab", (2000, 100))
    rows = [(60.0 * n, cell, n % 2) for n in range(2) for cell in range(0, 200_000, 1024)]
    for n in range(COMPACT_POSTS):
        post_rows(lively, "lab", rows[n::COMPACT_POSTS] or rows[:1])
    with working(lively):
        assert begun.wait(WAIT_S)
    assert len(merged) < find_location(lively, "lab").n_chunks
    assert compacted(lively, "lab") == 0
    monkeypatch.setattr(compaction, "merge", merge)
    compact_now(lively)
    assert compacted(lively, "lab") == COMPACT_POSTS


def test_what_has_served_its_time_is_pruned(lively: Context, clock: Clock) -> None:
    make_location(lively, "door")
    post_states(lively, "door", [0.0], [1])
    compact_now(lively, "door")
    clock.now += 8 * 86400

    def left() -> int:
        with lively.store.read() as work:
            return work.jobs._connection.execute(select(func.count()).select_from(observation)).scalar_one()

    assert left() == 1
    with working(lively):
        until(lambda: left() == 0)


def test_it_can_be_told_to_leave_things_alone(database_url: str) -> None:
    with opened(database_url, updater=False, updater_interval_s=0.02) as ctx:
        make_location(ctx, "door")
        post_many(ctx, COMPACT_POSTS + 1)
        with working(ctx) as compactor:
            time.sleep(0.1)
            assert compactor.alive(), "it has no work, and so it lacks nothing"
        assert compacted(ctx) == 0


def test_one_that_never_started_can_be_stopped(lively: Context) -> None:
    compactor = Compactor(lively, LeaderElection(lively))
    assert not compactor.alive()
    compactor.stop()


def test_a_check_ends_a_compaction_between_two_segments(ctx: Context) -> None:
    steps = iter(range(3))

    def check() -> None:
        if next(steps, None) is None:
            raise ShuttingDownError

    make_location(ctx, "lab", (100, 100))
    post_rows(ctx, "lab", [(0.0, cell, 1) for cell in range(0, 10_000, 1000)])
    with pytest.raises(ShuttingDownError):
        compaction.compact(ctx, find_location(ctx, "lab"), check)
    assert compacted(ctx, "lab") == 0
    assert not ctx.compacting.locked()


def test_nobody_forgets_what_a_compaction_is_about_to_write_back(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has read a segment, retention drops what is in it, and then it is written: all of it would be there again."""
    read, go_on = Event(), Event()
    before = compaction.segment_before

    def slow(*arguments: Any) -> Any:
        found = before(*arguments)
        read.set()
        assert go_on.wait(WAIT_S)
        return found

    make_location(ctx, "lab", (4, 4))
    post_rows(ctx, "lab", [(NOW - 6000.0, 3, 1)])
    compact_now(ctx)
    post_rows(ctx, "lab", [(NOW, 3, 1)])
    change_location(ctx, "lab", LocationChanges(retention_s=600.0))
    monkeypatch.setattr(compaction, "segment_before", slow)
    location = find_location(ctx, "lab")
    with ThreadPoolExecutor(2) as pool:
        compacting = pool.submit(compact_now, ctx)
        assert read.wait(WAIT_S)
        forgetting = pool.submit(compaction.forget, ctx, location)
        early = wait([forgetting], 0.5).done
        go_on.set()
        assert not early
        compacting.result(WAIT_S)
        forgetting.result(WAIT_S)
    latest = int(location.base.sample(NOW))
    states = history_of(ctx, "lab", 0, latest - 100, latest + 1).states()[3]
    assert np.flatnonzero(states != UNOBSERVED).tolist() == [100]
    assert find_location(ctx, "lab").first_time == NOW
