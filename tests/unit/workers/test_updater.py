"""The updater: refits by itself what has grown, runs what was asked for, and nothing stops it."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from threading import Event
from typing import Any

import numpy as np
import pytest
from sqlalchemy import update

from tests.support.contexts import (
    NOW,
    Clock,
    at_work,
    compact_now,
    elected,
    make_location,
    opened,
    post_rows,
    post_states,
)
from tests.support.waiting import WAIT_S, until
from tidemap.errors import (
    CorruptChunkError,
    JobFinishedError,
    JobNotFoundError,
    QueueFullError,
    StorageUnavailableError,
)
from tidemap.events.messages import EventMessage
from tidemap.services import jobs as jobs_service
from tidemap.services.context import Context
from tidemap.services.jobs import cancel_job, claim_job, get_job, list_jobs, request_update
from tidemap.services.locations import delete_location, find_location, get_location
from tidemap.services.state import StateQuery, state_at
from tidemap.services.update import UpdateRequest, run_update
from tidemap.services.update_task import ChunkFit, run_task
from tidemap.spectral.recipe import Recipe
from tidemap.storage.records import JobRecord, LocationRecord, RevisionRecord
from tidemap.storage.repositories.jobs import JobRepository
from tidemap.storage.tables import history
from tidemap.workers import updater as updater_module
from tidemap.workers.election import LeaderElection
from tidemap.workers.executors import LocalExecutor
from tidemap.workers.updater import Updater, is_due, urgency

STATIC = UpdateRequest(estimator="static")


@contextmanager
def working(ctx: Context) -> Iterator[Updater]:
    """An updater at work."""
    with elected(ctx) as election, at_work(Updater(ctx, election)) as updater:
        yield updater


def finished(ctx: Context, number: int) -> JobRecord | None:
    job = get_job(ctx, number)
    return job if job.finished_at is not None else None


def location_of(ctx: Context, **changes: Any) -> LocationRecord:
    make_location(ctx, "door")
    return replace(find_location(ctx, "door"), **changes)


def revision_of(location: LocationRecord, **changes: Any) -> RevisionRecord:
    made = RevisionRecord(location.id, 1, Recipe("static", 0), 0, 100, 1, 1000, 0.5, NOW, None)
    return replace(made, **changes)


@pytest.mark.parametrize(("measurements", "due"), [(0, False), (1, False), (2, True), (50, True)])
@pytest.mark.parametrize("span_s", [60.0, 9e9])
def test_the_first_update_is_due_once_there_are_measurements_however_far_apart(
    ctx: Context, measurements: int, span_s: float, due: bool
) -> None:
    location = location_of(ctx, first_time=0.0, last_time=span_s, measurements=measurements)
    assert is_due(ctx, location, None) is due


def test_more_may_be_asked_for(database_url: str) -> None:
    with opened(database_url, update_samples=48) as ctx:
        assert not is_due(ctx, location_of(ctx, measurements=47), None)
        assert is_due(ctx, replace(find_location(ctx, "door"), measurements=48), None)


@pytest.mark.parametrize(
    ("measurements", "later_s", "due"),
    [
        (1000, 1e9, False),
        (1001, 86_399.0, False),
        (1001, 86_400.0, True),
        (1099, 1e3, False),
        (1100, 29.0, False),
        (1100, 30.0, True),
        (9999, 0.0, False),
    ],
)
def test_another_is_due_when_the_history_has_grown_enough_or_long_ago(
    ctx: Context, clock: Clock, measurements: int, later_s: float, due: bool
) -> None:
    location = location_of(ctx, first_time=0.0, last_time=1e6, measurements=measurements)
    clock.now += later_s
    assert is_due(ctx, location, revision_of(location)) is due


@pytest.mark.parametrize(("deleted", "later_s", "due"), [(0, 1e9, False), (1, 86_400.0, True), (100, 30.0, True)])
def test_another_is_due_when_measurements_were_deleted(
    ctx: Context, clock: Clock, deleted: int, later_s: float, due: bool
) -> None:
    location = location_of(ctx, first_time=0.0, last_time=1e6, measurements=1000, deleted=deleted)
    clock.now += later_s
    assert is_due(ctx, location, revision_of(location)) is due


def test_the_stale_and_the_small_are_updated_first(ctx: Context) -> None:
    make_location(ctx, "lab", (100, 100))
    small, large = location_of(ctx), find_location(ctx, "lab")
    lately, long_ago = NOW - 60.0, NOW - 5 * 60.0
    order = [
        urgency(large, None, NOW),
        urgency(small, revision_of(small, updated_at=long_ago), NOW),
        urgency(small, revision_of(small, updated_at=lately), NOW),
        urgency(large, revision_of(large, updated_at=long_ago), NOW),
        urgency(large, revision_of(large, updated_at=lately), NOW),
    ]
    assert order == sorted(order, reverse=True)
    assert len(set(order)) == len(order)


def test_posts_become_a_model_without_anybody_asking(lively: Context, clock: Clock) -> None:
    make_location(lively, "door", estimator="static")
    with working(lively):
        post_states(lively, "door", [0.0], [1])
        time.sleep(0.1)
        assert find_location(lively, "door").revision == 0
        post_states(lively, "door", 60.0 * np.arange(1, 60), np.ones(59))
        until(lambda: find_location(lively, "door").revision == 1)
        post_states(lively, "door", 60.0 * np.arange(60, 80), np.zeros(20))
        time.sleep(0.1)
        assert find_location(lively, "door").revision == 1, "the last update has not rested"
        clock.now += 60
        until(lambda: find_location(lively, "door").revision == 2)
    assert state_at(lively, "door", StateQuery(0.0)).probability.tolist() == [np.float32(60.5 / 81)]
    assert {job.state for job in list_jobs(lively, None, 10)} == {"done"}
    assert len(list_jobs(lively, None, 10)) == 2


def test_an_update_that_fails_is_not_asked_for_all_the_time(lively: Context, clock: Clock) -> None:
    make_location(lively, "door", estimator="fft", order=1)
    post_states(lively, "door", 60.0 * np.arange(60), np.ones(60))
    compact_now(lively, "door")
    lively.store.write(lambda work: work.jobs._connection.execute(update(history).values(payload=b"")))
    door, rest_s = find_location(lively, "door").id, lively.settings.update_rest_s
    with working(lively) as updater:
        until(lambda: updater._retries._due.get(door) == clock.now + rest_s)
        time.sleep(0.2)
        assert len(list_jobs(lively, None, 9)) == 1
        clock.now += rest_s
        until(lambda: updater._retries._due.get(door) == clock.now + 2 * rest_s)
        # Ever more rarely.
        clock.now += rest_s
        time.sleep(0.2)
        assert len(list_jobs(lively, None, 9)) == 2
        clock.now += rest_s
        until(lambda: len(list_jobs(lively, None, 9)) == 3)


def test_jobs_run_in_order_and_everybody_is_told(ctx: Context) -> None:
    make_location(ctx, "door")
    post_states(ctx, "door", [0.0, 60.0], [0, 1])
    heard: list[EventMessage] = []
    ctx.bus.subscribe(heard.append)
    with working(ctx):
        first, second = (request_update(ctx, "door", STATIC) for _ in range(2))
        done = until(lambda: finished(ctx, second.id))
    assert (done.state, done.progress, done.error) == ("done", 1.0, None)
    assert done.result is not None
    assert (done.result["revision"], done.result["estimator"]) == (2, "static")
    assert get_job(ctx, first.id).state == "done"
    states = [message.data["state"] for message in heard if message.kind == "job" and message.id == second.id]
    assert states == ["queued", "running", "done"]
    assert [message.id for message in heard if message.kind == "update"] == [1, 2]


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        (UpdateRequest(start=1e9), "nothing was observed"),
        (UpdateRequest(estimator="oracle", order=1), "unknown estimator"),
    ],
)
def test_a_job_that_fails_says_why_and_the_next_runs(ctx: Context, request_: UpdateRequest, said: str) -> None:
    make_location(ctx, "door")
    post_states(ctx, "door", [0.0, 60.0], [0, 1])
    with working(ctx) as updater:
        bad = request_update(ctx, "door", request_)
        good = request_update(ctx, "door", STATIC)
        until(lambda: finished(ctx, good.id))
        assert updater.alive()
    assert (get_job(ctx, good.id).state, get_job(ctx, bad.id).state) == ("done", "failed")
    assert said in (get_job(ctx, bad.id).error or "")


def test_the_location_of_a_running_job_may_be_deleted(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("door", "gate"):
        make_location(ctx, name)
        post_states(ctx, name, [0.0, 60.0], [0, 1])
    begun, go_on = Event(), Event()
    fit = run_update

    def slow(*arguments: Any) -> RevisionRecord:
        begun.set()
        assert go_on.wait(WAIT_S)
        return fit(*arguments)

    monkeypatch.setattr(jobs_service, "run_update", slow)
    with working(ctx) as updater:
        gone = request_update(ctx, "door", STATIC)
        assert begun.wait(WAIT_S)
        delete_location(ctx, "door")
        go_on.set()
        until(lambda: finished(ctx, request_update(ctx, "gate", STATIC).id) or True)
        until(lambda: find_location(ctx, "gate").revision)
        assert updater.alive()
    with pytest.raises(JobNotFoundError):
        get_job(ctx, gone.id)


def test_only_a_queued_job_can_be_cancelled(ctx: Context) -> None:
    make_location(ctx, "door")
    first, second = (request_update(ctx, "door", STATIC) for _ in range(2))
    assert cancel_job(ctx, second.id).state == "cancelled"
    for number, state in ((second.id, "cancelled"), (first.id, "running")):
        if state == "running":
            claim_job(ctx, frozenset())
        with pytest.raises(JobFinishedError, match=f"is {state}"):
            cancel_job(ctx, number)
    with pytest.raises(JobNotFoundError):
        cancel_job(ctx, 99)


def make_lab(ctx: Context) -> None:
    """A grid of several chunks."""
    make_location(ctx, "lab", (80, 80))
    post_rows(ctx, "lab", [(60.0 * n, cell, n % 2) for n in range(4) for cell in range(0, 6400, 100)])


def test_a_job_that_the_end_interrupts_runs_again_at_the_next_start(
    database_url: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    from tidemap.services import update

    begun, go_on = Event(), Event()
    fit = run_task

    def slow(*arguments: Any) -> ChunkFit | CorruptChunkError:
        begun.set()
        go_on.wait(WAIT_S)
        return fit(*arguments)

    monkeypatch.setattr(update, "run_task", slow)
    with opened(database_url, update_threads=1) as ctx:
        make_lab(ctx)
        with working(ctx) as updater:
            job = request_update(ctx, "lab", STATIC)
            assert begun.wait(WAIT_S)
            assert isinstance(updater._executor, LocalExecutor)
            updater._executor._closed = True
            updater._executor._pool.shutdown(wait=False, cancel_futures=True)
            go_on.set()
        assert get_job(ctx, job.id).state == "running"
        assert "failed" not in caplog.text
    monkeypatch.setattr(update, "run_task", fit)
    with opened(database_url) as ctx, working(ctx):
        done = until(lambda: finished(ctx, job.id))
        assert done.state == "done"
        assert done.result is not None
        assert get_location(ctx, "lab").revision == done.result["revision"]


def test_the_end_of_a_job_is_stored_once_the_database_is_back(lively: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    make_location(lively, "door")
    post_states(lively, "door", [0.0, 60.0], [0, 1])
    write = lively.store.write
    away = Event()

    def refuse(_: Any, *arguments: Any) -> Any:
        if away.is_set():
            raise StorageUnavailableError
        return write(*arguments)

    monkeypatch.setattr("tidemap.storage.store.Store.write", refuse)
    job = request_update(lively, "door", STATIC)
    lively.bus.subscribe(lambda message: away.set() if message.data.get("state") == "running" else None)
    with working(lively):
        until(away.is_set)
        time.sleep(0.1)
        assert get_job(lively, job.id).state == "running"
        monkeypatch.setattr("tidemap.storage.store.Store.write", lambda _, *arguments: write(*arguments))
        assert until(lambda: finished(lively, job.id)).state == "done"


def test_a_revision_is_visible_only_with_the_end_of_its_job(lively: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else one that dies between the two would run again, and publish twice."""
    make_location(lively, "door")
    post_states(lively, "door", [0.0, 60.0], [0, 1])
    transition = JobRepository.transition
    tried: list[str] = []

    def die(jobs: JobRepository, job_id: int, expected: str, **values: Any) -> bool:
        # Twice: the writer tries a write of a group again, alone.
        if values["state"] == "done" and len(tried) < 2:
            tried.append("done")
            raise StorageUnavailableError
        return transition(jobs, job_id, expected, **values)

    def see(message: EventMessage) -> None:
        if message.data.get("state") == "running":
            revisions.append(find_location(lively, "door").revision)

    revisions: list[int] = []
    lively.bus.subscribe(see)
    monkeypatch.setattr(JobRepository, "transition", die)
    # Before the updater begins: it would ask for an update too.
    job = request_update(lively, "door", STATIC)
    with working(lively):
        assert until(lambda: finished(lively, job.id)).state == "done"
    assert len(tried) == 2
    assert revisions == [0, 0], "nothing of the first run was published"


def test_a_job_runs_even_if_it_is_not_known_whether_it_was_claimed(
    lively: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_location(lively, "door")
    post_states(lively, "door", [0.0, 60.0], [0, 1])
    job = request_update(lively, "door", STATIC)
    write = lively.store.write
    lost = [StorageUnavailableError()]

    def lose_the_answer(_: Any, *arguments: Any) -> Any:
        result = write(*arguments)
        if isinstance(result, JobRecord) and lost:
            raise lost.pop()
        return result

    monkeypatch.setattr("tidemap.storage.store.Store.write", lose_the_answer)
    with working(lively):
        assert until(lambda: finished(lively, job.id)).state == "done"
    assert lost == []


def test_a_job_does_not_fail_because_the_database_is_away(lively: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    from tidemap.services import update

    away = [StorageUnavailableError(), StorageUnavailableError()]
    plan = update._plan

    def read(*arguments: Any) -> Any:
        if away:
            raise away.pop()
        return plan(*arguments)

    monkeypatch.setattr(update, "_plan", read)
    make_location(lively, "door")
    post_states(lively, "door", [0.0, 60.0], [0, 1])
    with working(lively):
        job = request_update(lively, "door", STATIC)
        assert until(lambda: finished(lively, job.id)).state == "done"
    assert away == []


def test_a_full_queue_does_not_fail_an_update_for_its_progress(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise QueueFullError

    make_lab(ctx)
    monkeypatch.setattr("tidemap.storage.store.Store.submit", refuse)
    with working(ctx):
        job = request_update(ctx, "lab", STATIC)
        assert until(lambda: finished(ctx, job.id)).state == "done"


def test_one_location_that_cannot_be_cared_for_keeps_no_other_from_it(
    lively: Context, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    due = updater_module.is_due

    def odd(ctx: Context, location: LocationRecord, revision: RevisionRecord | None) -> bool:
        if location.name == "attic":
            raise ArithmeticError("odd")
        return due(ctx, location, revision)

    monkeypatch.setattr(updater_module, "is_due", odd)
    for name in ("attic", "door"):
        make_location(lively, name)
        post_states(lively, name, 60.0 * np.arange(60), np.ones(60))
    with working(lively):
        until(lambda: find_location(lively, "door").revision)
    assert "location attic" in caplog.text


def test_the_updater_can_be_told_to_leave_things_alone(database_url: str) -> None:
    with opened(database_url, updater=False, updater_interval_s=0.02) as ctx:
        make_location(ctx, "door")
        post_states(ctx, "door", 60.0 * np.arange(60), np.ones(60))
        with working(ctx):
            time.sleep(0.1)
        assert find_location(ctx, "door").revision == 0


def test_an_updater_that_never_started_can_be_stopped(ctx: Context) -> None:
    updater = Updater(ctx, LeaderElection(ctx))
    assert not updater.alive()
    updater.stop()
