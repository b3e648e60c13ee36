"""At every moment log and segments together are the history: the services against a plain dictionary."""

from contextlib import ExitStack, nullcontext, suppress
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from sqlalchemy import func, select

from tests.support.contexts import Clock, compact_now, history_of, make_location, opened, post_rows, refit
from tests.support.databases import Databases
from tests.support.truth import Row, Truth, put, states_of
from tidemap.errors import InvalidInputError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.combining import ANY, LATEST
from tidemap.history.history import NEVER, UNOBSERVED
from tidemap.history.timebase import TimeBase
from tidemap.services.context import Context
from tidemap.services.deletion import Deletion, delete_observations
from tidemap.services.locations import LocationChanges, change_location, delete_location, find_location
from tidemap.services.readings import last_seen
from tidemap.services.verify import Finding, verify
from tidemap.storage.engine import open_reader
from tidemap.storage.tables import metadata

SHAPE = (13, 10, 9)
BASE = TimeBase(1000.25, 60.0)
CELLS = (0, 1, 1022, 1023, 1024, 1169)
SAMPLES = (-8193, -4097, -4096, -4095, -1, 0, 1, 4095, 4096, 5000)
WHOLE = range(-8300, 5100)
NAMES = count()
NOW = float(BASE.time(5001))
ROWS = st.builds(
    lambda sample, offset, cell, state: (float(BASE.time(sample)) + offset, cell, state),
    st.sampled_from(SAMPLES),
    st.sampled_from((0.0, 0.25, 59.5)),
    st.sampled_from(CELLS),
    st.integers(0, 1),
)
"""Rows of one post do not contradict each other; those of two posts may."""
POSTS = st.lists(ROWS, min_size=1, max_size=8, unique_by=lambda row: row[:2])


class EndedError(Exception):
    """The process is no more."""


@dataclass
class MortalStore:
    """A store whose process ends after some more writes."""

    store: Any
    writes: int

    def __getattr__(self, name: str) -> Any:
        return getattr(self.store, name)

    def write(self, *arguments: Any) -> Any:
        if not self.writes:
            raise EndedError
        self.writes -= 1
        return self.store.write(*arguments)


class HistoryMachine(RuleBasedStateMachine):
    """Posts of all kinds, compactions, updates, deletions, restarts and crashes in any order."""

    url: str
    truth: Truth
    retention_s: float | None

    def __init__(self) -> None:
        super().__init__()
        self.stack = ExitStack()
        self.name = f"lab-{next(NAMES)}"

    @initialize(combine=st.sampled_from((LATEST, ANY)))
    def begin(self, combine: str) -> None:
        self.combine = combine
        self._open()
        self._make()

    def _open(self) -> None:
        self.ctx: Context = self.stack.enter_context(opened(self.url, Clock(NOW)))

    def teardown(self) -> None:
        self.stack.close()
        findings: list[Finding] = []
        verify(self.url, findings.append)
        assert findings == []

    @rule(rows=POSTS, source=st.sampled_from(("spot", "rover", None)))
    def post(self, rows: list[Row], source: str | None) -> None:
        key = f"k{len(self.posts)}"
        answer = post_rows(self.ctx, self.name, rows, idempotency_key=key, source=source)
        kept = self._kept(rows)
        assert (answer.accepted, answer.dropped, answer.duplicate) == (len(kept), len(rows) - len(kept), False)
        if kept:
            self.posts.append((key, rows))
        self._stored(kept)

    @precondition(lambda self: self.posts)
    @rule(data=st.data())
    def retry(self, data: st.DataObject) -> None:
        key, rows = data.draw(st.sampled_from(self.posts))
        answer = post_rows(self.ctx, self.name, rows, idempotency_key=key)
        assert (answer.accepted, answer.duplicate) == (0, True)

    @precondition(lambda self: self.posts)
    @rule(data=st.data())
    def repeat(self, data: st.DataObject) -> None:
        _, rows = data.draw(st.sampled_from(self.posts))
        post_rows(self.ctx, self.name, rows)
        self._stored(self._kept(rows))

    @rule()
    def compact(self) -> None:
        compact_now(self.ctx, self.name)

    @precondition(lambda self: self.truth)
    @rule()
    def update(self) -> None:
        if self.retention_s is not None:
            border = int(BASE.sample(NOW - self.retention_s))
            self.truth = {key: value for key, value in self.truth.items() if key[1] >= border}
        with nullcontext() if self.truth else pytest.raises(InvalidInputError, match="no observations"):
            refit(self.ctx, self.name, estimator="static")
        self._check_first_time()

    @rule(samples=st.sampled_from((1, 4097, 9000)))
    def retain(self, samples: int) -> None:
        self.retention_s = samples * BASE.interval_s
        change_location(self.ctx, self.name, LocationChanges(retention_s=self.retention_s))

    @rule(first=st.sampled_from(SAMPLES), length=st.sampled_from((1, 2, 4097, 20_000)))
    def delete_some(self, first: int, length: int) -> None:
        """Whole samples, so that it does not matter what was compacted before."""
        what = Deletion(float(BASE.time(first)), float(BASE.time(first + length)))
        left = {key: value for key, value in self.truth.items() if not first <= key[1] < first + length}
        assert delete_observations(self.ctx, self.name, what) >= len(self.truth) - len(left)
        self.truth = left

    @rule(writes=st.integers(0, 1), first=st.sampled_from(SAMPLES))
    def crash_in_a_deletion(self, writes: int, first: int) -> None:
        store: Any = MortalStore(self.ctx.store, writes)
        what = Deletion(float(BASE.time(first)), float(BASE.time(first + 2)))
        with suppress(EndedError):
            delete_observations(replace(self.ctx, store=store), self.name, what)
        if writes:
            self.truth = {key: value for key, value in self.truth.items() if not first <= key[1] < first + 2}
        self.crash()

    @rule()
    def restart(self) -> None:
        self.stack.close()
        self._open()

    @rule()
    def crash(self) -> None:
        """Nobody closes what was open."""
        self._open()

    @precondition(lambda self: self.truth and self.retention_s is None)
    @rule(writes=st.integers(0, 4))
    def crash_in_an_update(self, writes: int) -> None:
        store: Any = MortalStore(self.ctx.store, writes)
        with suppress(EndedError):
            refit(replace(self.ctx, store=store), self.name, estimator="static")
        self.crash()

    @rule()
    def delete(self) -> None:
        """All of it goes, and a new one has nothing of it, not even the keys."""
        number = find_location(self.ctx, self.name).id
        delete_location(self.ctx, self.name)
        assert rows_of(self.url, number) == {}
        self._make()

    @invariant()
    def the_history_is_the_dictionary(self) -> None:
        if not hasattr(self, "ctx"):
            return
        for chunk in range(2):
            first = chunk * CHUNK_CELLS
            mine = [cell for cell in CELLS if cell // CHUNK_CELLS == chunk]
            history = history_of(self.ctx, self.name, chunk, WHOLE.start, WHOLE.stop)
            expected = states_of(self.truth, range(first, first + CHUNK_CELLS), WHOLE.start, WHOLE.stop)
            local = [cell - first for cell in mine]
            np.testing.assert_array_equal(history.cells(local).states(), expected[local])
            assert history.count_observed().sum() == sum(cell in mine for cell, _ in self.truth)

    @invariant()
    def any_part_is_that_part_of_the_whole(self) -> None:
        if not hasattr(self, "ctx"):
            return
        for start, stop in ((-4097, -4095), (-1, 4097), (6000, 6010)):
            states = history_of(self.ctx, self.name, 1, start, stop).states()
            dense = states_of(self.truth, range(1024, 1170), start, stop)
            np.testing.assert_array_equal(states, dense)

    @invariant()
    def the_last_seen_is_the_latest_in_the_dictionary(self) -> None:
        if not hasattr(self, "ctx"):
            return
        location = find_location(self.ctx, self.name)
        for sample in (-4096, 4095, 10**9):
            found = last_seen(self.ctx, location, sample, np.array(CELLS))
            assert found.damaged == []
            for i, cell in enumerate(CELLS):
                before = [n for c, n in self.truth if c == cell and n <= sample]
                latest: Any = (self.truth[cell, max(before)][1], max(before)) if before else (UNOBSERVED, NEVER)
                assert (found.state[i], found.sample[i]) == latest

    @invariant()
    def nothing_is_counted_twice(self) -> None:
        if hasattr(self, "ctx"):
            location = find_location(self.ctx, self.name)
            assert location.measurements == self.measurements
            assert location.observation_seq >= len(self.posts)

    def _make(self) -> None:
        make_location(self.ctx, self.name, SHAPE, epoch=BASE.epoch, interval_s=BASE.interval_s, combine=self.combine)
        self.truth = {}
        self.posts: list[tuple[str, list[Row]]] = []
        self.measurements = 0
        self.retention_s = None

    def _stored(self, rows: list[Row]) -> None:
        put(self.truth, rows, BASE, self.combine)
        self.measurements += len(rows)

    def _kept(self, rows: list[Row]) -> list[Row]:
        """What is not too old to be stored."""
        return [row for row in rows if self.retention_s is None or row[0] >= NOW - self.retention_s]

    def _check_first_time(self) -> None:
        """Of an older measurement that another one stands for, too."""
        first = find_location(self.ctx, self.name).first_time
        assert (first is None) == (not self.truth)
        if first is not None:
            assert int(BASE.sample(first)) == min(sample for _, sample in self.truth)


def rows_of(url: str, location_id: int) -> dict[str, int]:
    """How many rows each table has of a location; those without any are left out."""
    engine = open_reader(url)
    with engine.connect() as connection:
        found = {
            table.name: connection.execute(select(func.count()).where(table.c.location_id == location_id)).scalar_one()
            for table in metadata.tables.values()
            if "location_id" in table.c
        }
    engine.dispose()
    return {name: number for name, number in found.items() if number}


def test_log_and_segments_are_the_history_at_every_moment(databases: Databases) -> None:
    with databases.migrated() as url:
        machine = type("Machine", (HistoryMachine,), {"url": url})
        run_state_machine_as_test(machine, settings=settings(max_examples=8, stateful_step_count=16))
