"""Leader election: one process at a time, a term that ends with its lock, and nothing stored after that."""

import logging
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError

from tests.support.contexts import at_work, elected, make_location, post_rows, post_states
from tests.support.waiting import WAIT_S, until
from tidemap.errors import NotLeaderError
from tidemap.history.segment import merge
from tidemap.services import compaction
from tidemap.services.context import Context
from tidemap.services.jobs import claim_job, get_job, request_update
from tidemap.services.locations import find_location
from tidemap.services.update import UpdateRequest
from tidemap.services.update_task import UpdateTask, run_task
from tidemap.storage.lock import FileLock
from tidemap.workers import election as election_module
from tidemap.workers.compactor import COMPACT_POSTS, Compactor
from tidemap.workers.election import LeaderElection, LeaderTerm
from tidemap.workers.updater import Updater

STATIC = UpdateRequest(estimator="static")


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(election_module, "BEAT_S", 0.02)


def lock_file(ctx: Context) -> Path:
    return Path(f"{ctx.settings.url.removeprefix('sqlite:///')}-background")


@contextmanager
def held_elsewhere(ctx: Context) -> Iterator[FileLock]:
    """Another process leads, until its lock is released."""
    other = FileLock(ctx.settings.url, lock_file(ctx))
    assert other.take() is not None
    try:
        yield other
    finally:
        other.release()


def take_away(ctx: Context, election: LeaderElection) -> LeaderTerm:
    """Have it lose its lock, and notice; the term that it had."""
    term = election.term
    assert term is not None
    lock_file(ctx).unlink()
    until(lambda: election.term is not term)
    return term


def steal(ctx: Context, other: FileLock) -> bool:
    """Whether another process has the lock then."""
    lock_file(ctx).unlink(missing_ok=True)
    return other.take() is not None


def number_of(election: LeaderElection) -> int | None:
    """The number of its term, None while it has none."""
    return None if election.term is None else election.term.number


def test_the_first_leads_and_the_second_after_it(ctx: Context) -> None:
    begun = Event()
    second = LeaderElection(ctx)
    second.on_begin(begun.set)
    with elected(ctx) as first:
        until(lambda: first.term is not None)
        second.start()
        time.sleep(0.1)
        assert number_of(second) is None
        assert not begun.is_set()
        term = first.term
    assert term is not None
    with pytest.raises(NotLeaderError):
        term.check()
    try:
        assert begun.wait(WAIT_S)
        assert (number_of(second) or 0) > term.number
        assert second.alive()
    finally:
        second.stop()
    assert number_of(second) is None
    assert not second.alive()


def test_a_term_ends_with_its_lock(ctx: Context, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    with elected(ctx) as election:
        until(lambda: election.term is not None)
        old = take_away(ctx, election)
        with pytest.raises(NotLeaderError):
            old.check()
        until(lambda: election.term is not None)
        assert election.term is not None
        election.term.check()
        with pytest.raises(NotLeaderError):
            old.limit(ctx).store.write(lambda work: None)
        election.term.limit(ctx).store.write(lambda work: None)
    assert caplog.text.count("does the background work from now on") == 2
    assert caplog.text.count("does the background work no longer") == 1


def test_who_hears_from_the_database_that_another_began_gives_up(ctx: Context) -> None:
    """The lock seems to be held still: somebody has removed its file."""
    with elected(ctx) as election:
        until(lambda: election.term is not None)
        term = election.term
        assert term is not None
        ctx.store.write(lambda work: work.terms.begin())
        with pytest.raises(NotLeaderError):
            term.limit(ctx).store.write(lambda work: None)
        until(lambda: election.term is not None and election.term is not term)


def make_lab(ctx: Context) -> None:
    """A grid of several chunks."""
    make_location(ctx, "lab", (80, 80))
    post_rows(ctx, "lab", [(60.0 * n, cell, n % 2) for n in range(4) for cell in range(0, 6400, 100)])


def test_an_update_whose_term_ends_publishes_nothing_and_runs_again(
    lively: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tidemap.services import update

    begun, go_on = Event(), Event()
    fit = run_task
    fitted: list[int] = []

    def slow(ctx: Context, task: UpdateTask) -> Any:
        begun.set()
        assert go_on.wait(WAIT_S)
        fitted.append(task.plan.number)
        return fit(ctx, task)

    monkeypatch.setattr(update, "run_task", slow)
    make_lab(lively)
    with elected(lively) as election, at_work(Updater(lively, election)):
        job = request_update(lively, "lab", STATIC)
        assert begun.wait(WAIT_S)
        take_away(lively, election)
        until(lambda: election.term is not None)
        assert find_location(lively, "lab").revision == 0
        go_on.set()
        until(lambda: get_job(lively, job.id).state == "done")
    assert len(fitted) > find_location(lively, "lab").n_chunks, "it ran again"
    with lively.store.read() as work:
        published = work.spectra.current()[find_location(lively, "lab").id]
    assert get_job(lively, job.id).result == {
        name: getattr(published, name) for name in ("revision", "estimator", "order", "accuracy", "selection")
    }


def test_jobs_that_others_run_are_left_alone(lively: Context) -> None:
    make_location(lively, "door")
    post_states(lively, "door", [0.0, 60.0], [0, 1])
    job = request_update(lively, "door", STATIC)
    claim_job(lively, frozenset())
    with held_elsewhere(lively) as other, elected(lively) as election, at_work(Updater(lively, election)) as updater:
        time.sleep(0.2)
        assert updater.alive()
        assert get_job(lively, job.id).state == "running"
        other.release()
        until(lambda: get_job(lively, job.id).state == "done")


def test_jobs_that_the_holder_between_left_run_again(lively: Context) -> None:
    """This process led before, and had left nothing running."""
    make_location(lively, "door")
    post_states(lively, "door", [0.0, 60.0], [0, 1])
    with elected(lively) as election, at_work(Updater(lively, election)) as updater:
        until(lambda: updater._settled is not None)
        other = FileLock(lively.settings.url, lock_file(lively))
        until(lambda: steal(lively, other))
        until(lambda: election.term is None)
        job = request_update(lively, "door", STATIC)
        assert claim_job(lively, frozenset()) is not None
        other.release()
        until(lambda: get_job(lively, job.id).state == "done")


def test_a_follower_too_finds_out_when_the_database_can_be_written_again(lively: Context) -> None:
    """A server that is not ready gets no posts that would show it."""
    with held_elsewhere(lively), elected(lively) as election, at_work(Updater(lively, election)):
        lively.store._writer.outage.failed(OperationalError("INSERT", {}, sqlite3.OperationalError("disk is full")))
        assert lively.store.outage() is not None
        until(lambda: lively.store.outage() is None)
        assert election.term is None


def test_by_a_follower_nothing_is_compacted_but_posts_are_slowed_down(
    lively: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tidemap.workers.compactor.LATE_MEASUREMENTS", 100)
    make_location(lively, "door")
    with (
        held_elsewhere(lively) as other,
        elected(lively) as election,
        at_work(Compactor(lively, election)) as compactor,
    ):
        for _ in range(COMPACT_POSTS):
            post_states(lively, "door", [0.0], [1])
        until(lambda: compactor._waiting == COMPACT_POSTS)
        post_states(lively, "door", [0.0], [1])
        assert lively.store._writer.rest_s > 0
        assert find_location(lively, "door").compacted_seq == 0
        other.release()
        until(lambda: find_location(lively, "door").compacted_seq >= COMPACT_POSTS)


def test_a_compaction_whose_term_ends_stores_nothing(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    make_lab(ctx)
    begun: list[int] = []

    def merged(*arguments: Any) -> Any:
        if not begun:
            begun.append(ctx.store.write(lambda work: work.terms.begin()))
        return merge(*arguments)

    monkeypatch.setattr(compaction, "merge", merged)
    mine = LeaderTerm(ctx.store.write(lambda work: work.terms.begin())).limit(ctx)
    with pytest.raises(NotLeaderError):
        compaction.compact(mine, find_location(ctx, "lab"))
    assert find_location(ctx, "lab").compacted_seq == 0
    assert begun
