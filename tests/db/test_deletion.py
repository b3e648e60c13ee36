"""Deletion: what is asked for goes, out of log and history, and nothing else; all of it or nothing."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from typing import Any

import numpy as np
import pytest

from tests.db.test_damage import damage
from tests.support.contexts import (
    NOW,
    Clock,
    compact_now,
    history_of,
    make_location,
    opened,
    post_rows,
    post_states,
    refit,
)
from tests.support.waiting import WAIT_S
from tidemap.errors import CorruptChunkError, InvalidInputError, LocationNotFoundError, ShuttingDownError
from tidemap.events.messages import EventMessage
from tidemap.history.history import UNOBSERVED
from tidemap.services import compaction
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.deletion import Deletion, delete_observations
from tidemap.services.history import window
from tidemap.services.locations import find_location, get_location
from tidemap.services.pruning import prune
from tidemap.services.series import series
from tidemap.services.verify import verify
from tidemap.settings import DAY_S, WEEK_S
from tidemap.storage.tables import history, source

MINUTE = 60.0
EVER = Deletion(-1e9, 1e10)
WAYS = pytest.mark.parametrize("compacted", [False, True])


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def ctx(database_url: str, clock: Clock) -> Iterator[Context]:
    with opened(database_url, clock) as context:
        yield context
        verify(database_url, lambda finding: pytest.fail(str(finding)))


def door_of(ctx: Context, name: str = "door", stop: int = 12) -> list[int]:
    return list(history_of(ctx, name, 0, 0, stop).states()[0].tolist())


def at_work(ctx: Context, *shifts: tuple[str | None, int, int]) -> None:
    """A door that robots saw occupied in minutes [start, stop), each its own."""
    make_location(ctx, "door")
    for robot, start, stop in shifts:
        post_states(ctx, "door", MINUTE * np.arange(start, stop), np.ones(stop - start), source=robot)


@WAYS
def test_a_reading_of_a_wrong_clock_goes_as_if_it_had_never_been(ctx: Context, compacted: bool) -> None:
    make_location(ctx, "door")
    times = NOW - DAY_S + 600.0 * np.arange(144)
    post_states(ctx, "door", times, np.arange(144) % 2)
    before, span = get_location(ctx, "door"), window(ctx, find_location(ctx, "door"))
    post_states(ctx, "door", [37.0], [1])
    refit(ctx, "door", estimator="static") if compacted else None
    assert get_location(ctx, "door").first_time == 37.0
    assert delete_observations(ctx, "door", Deletion(0.0, 60.0)) == 1
    after = get_location(ctx, "door")
    assert (after.observations, after.first_time, after.last_time) == (144, before.first_time, before.last_time)
    assert window(ctx, find_location(ctx, "door")) == span
    assert np.count_nonzero(series(ctx, "door").observed != UNOBSERVED) == 144
    revision = refit(ctx, "door", estimator="fft", order=1)
    assert (revision.start, revision.stop) == span
    assert delete_observations(ctx, "door", Deletion(0.0, 60.0)) == 0


@WAYS
def test_the_border_is_a_time_and_the_last_one_stays(ctx: Context, compacted: bool) -> None:
    at_work(ctx, (None, 0, 12))
    if compacted:
        compact_now(ctx, "door")
    assert delete_observations(ctx, "door", Deletion(MINUTE * 3, MINUTE * 5)) == 2
    assert door_of(ctx) == [1, 1, 1, 2, 2, 1, 1, 1, 1, 1, 1, 1]
    assert delete_observations(ctx, "door", Deletion(MINUTE * 11, MINUTE * 99)) == 1
    assert delete_observations(ctx, "door", Deletion(-MINUTE, MINUTE)) == 1
    shown = get_location(ctx, "door")
    assert (shown.observations, shown.first_time, shown.last_time) == (8, MINUTE, MINUTE * 10)


@WAYS
def test_nothing_may_be_left_and_more_may_come(ctx: Context, compacted: bool) -> None:
    at_work(ctx, (None, 0, 6))
    post_states(ctx, "door", [10.0], [0])
    if compacted:
        compact_now(ctx, "door")
    # Of one sample, where two were compacted, one is left to be deleted.
    assert delete_observations(ctx, "door", EVER) == (6 if compacted else 7)
    shown = get_location(ctx, "door")
    assert (shown.observations, shown.first_time, shown.last_time) == (0, None, None)
    with pytest.raises(InvalidInputError, match="no observations"):
        refit(ctx, "door")
    post_states(ctx, "door", [MINUTE], [0])
    assert door_of(ctx, stop=3) == [2, 0, 2]
    assert get_location(ctx, "door").observations == 1


def test_the_log_knows_each_robot(ctx: Context) -> None:
    at_work(ctx, ("spot", 0, 8), ("rover", 4, 12), (None, 4, 5))
    assert delete_observations(ctx, "door", Deletion(0.0, MINUTE * 12, "rover")) == 8
    assert door_of(ctx) == [1] * 8 + [2] * 4
    assert delete_observations(ctx, "door", Deletion(0.0, MINUTE * 2)) == 2


@pytest.mark.parametrize("pruned", [False, True])
def test_in_the_history_a_robot_is_known_where_it_was_alone(ctx: Context, clock: Clock, pruned: bool) -> None:
    at_work(ctx, ("spot", 0, 8), ("rover", 6, 12))
    compact_now(ctx, "door")
    if pruned:
        clock.now += WEEK_S + 1
        assert prune(ctx) == 2
    with pytest.raises(InvalidInputError, match=r"'spot' measured .* together with what was measured by 'rover'"):
        delete_observations(ctx, "door", Deletion(0.0, MINUTE * 7, "spot"))
    assert delete_observations(ctx, "door", Deletion(0.0, MINUTE * 12, "nobody")) == 0
    assert door_of(ctx) == [1] * 12
    assert delete_observations(ctx, "door", Deletion(0.0, MINUTE * 6, "spot")) == 6
    assert door_of(ctx) == [2] * 6 + [1] * 6


def test_robots_that_post_look_by_look_are_told_apart(ctx: Context) -> None:
    make_location(ctx, "door")
    for n in range(12):
        post_states(ctx, "door", [MINUTE * n + n % 2], [n % 2], source=("spot", "rover")[n % 2])
    compact_now(ctx, "door")
    assert delete_observations(ctx, "door", Deletion(MINUTE * 2, MINUTE * 8, "rover")) == 3
    assert door_of(ctx) == [0, 1, 0, 2, 0, 2, 0, 2, 0, 1, 0, 1]
    shown = get_location(ctx, "door")
    assert (shown.observations, shown.first_time, shown.last_time) == (9, 0.0, MINUTE * 11 + 1)


def test_the_votes_of_robots_are_not_told_apart(ctx: Context) -> None:
    make_location(ctx, "door", combine="majority")
    for n in range(12):
        post_states(ctx, "door", [10.0 * n], [n % 2], source=("spot", "rover")[n % 2])
    compact_now(ctx, "door")
    with pytest.raises(InvalidInputError, match="'rover' measured"):
        delete_observations(ctx, "door", Deletion(0.0, MINUTE * 2, "rover"))
    assert delete_observations(ctx, "door", Deletion(0.0, MINUTE)) == 1


def test_what_was_pruned_before_sources_were_kept_may_be_of_anybody(ctx: Context) -> None:
    at_work(ctx, ("spot", 0, 8))
    compact_now(ctx, "door")
    row = {"location_id": find_location(ctx, "door").id, "name": "*", "first_time": 0.0, "last_time": 90.0}
    ctx.store.write(lambda work: work.jobs._connection.execute(source.insert().values(**row)))
    with pytest.raises(InvalidInputError, match="robots that are not known any more"):
        delete_observations(ctx, "door", Deletion(0.0, MINUTE * 8, "spot"))
    assert delete_observations(ctx, "door", Deletion(MINUTE * 2, MINUTE * 8, "spot")) == 6


@pytest.mark.parametrize("combine", ["latest", "any", "majority"])
@WAYS
def test_whole_samples_go_however_they_are_combined(ctx: Context, combine: Any, compacted: bool) -> None:
    make_location(ctx, "door", combine=combine)
    times = np.arange(0.0, 360.0, 10.0)
    post_states(ctx, "door", times, times % 60 < 40)
    if compacted:
        compact_now(ctx, "door")
    state = 0 if combine == "latest" else 1
    assert door_of(ctx, stop=6) == [state] * 6
    delete_observations(ctx, "door", Deletion(MINUTE, MINUTE * 4))
    assert door_of(ctx, stop=6) == [state, 2, 2, 2, state, state]
    # What is left goes on being counted.
    post_states(ctx, "door", np.arange(1.0, 58.0), np.zeros(57))
    assert door_of(ctx, stop=1) == [{"latest": 0, "any": 1, "majority": 0}[combine]]


def test_other_cells_chunks_and_locations_stay(ctx: Context) -> None:
    rows = [(MINUTE * n, cell, 1) for n in range(0, 9000, 1000) for cell in (7, 1500, 3000)]
    for name in ("lab", "attic"):
        make_location(ctx, name, (80, 40))
        post_rows(ctx, name, rows)
        compact_now(ctx, name)
    post_rows(ctx, "lab", [(MINUTE * 4000 + 1, 8, 1), (MINUTE * 4000 + 2, 3000, 0), (MINUTE * 8000, 9, 0)])
    assert delete_observations(ctx, "lab", Deletion(MINUTE * 3000, MINUTE * 5000)) == 8
    for chunk, cells in enumerate(((7, 8, 9), (1500 - 1024,), (3000 - 2048,))):
        states = history_of(ctx, "lab", chunk, 0, 9000).states()
        for cell in cells:
            seen = np.flatnonzero(states[cell] != UNOBSERVED).tolist()
            assert seen == {8: [], 9: [8000]}.get(cell, [0, 1000, 2000, 5000, 6000, 7000, 8000])
    assert get_location(ctx, "attic").observations == len(rows)
    assert history_of(ctx, "attic", 0, 0, 9000).count_observed().sum() == 9


def test_another_process_sees_it_at_once(ctx: Context, database_url: str) -> None:
    at_work(ctx, ("spot", 0, 8))
    compact_now(ctx, "door")
    with opened(database_url) as other:
        assert door_of(other) == [1] * 8 + [2] * 4
        delete_observations(ctx, "door", Deletion(0.0, MINUTE * 7))
        assert door_of(other) == [2] * 7 + [1] + [2] * 4


def test_no_compaction_under_way_elsewhere_brings_it_back(
    ctx: Context, database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has read the segment, and would write what it has read."""
    at_work(ctx, ("spot", 0, 8))
    compact_now(ctx, "door")
    read, go_on, before = Event(), Event(), compaction.segment_before

    def slow(*arguments: Any) -> Any:
        found = before(*arguments)
        read.set()
        assert go_on.wait(WAIT_S)
        return found

    with opened(database_url) as other, ThreadPoolExecutor(1) as pool:
        post_states(ctx, "door", [MINUTE * 9], [1])
        monkeypatch.setattr(compaction, "segment_before", slow)
        compacting = pool.submit(compact_now, other, "door")
        assert read.wait(WAIT_S)
        monkeypatch.setattr(compaction, "segment_before", before)
        assert delete_observations(ctx, "door", Deletion(0.0, MINUTE * 7)) == 7
        go_on.set()
        compacting.result(WAIT_S)
        assert door_of(other) == [2] * 7 + [1, 2, 1, 2, 2]


def test_posts_and_deletions_at_once_lose_nothing(ctx: Context) -> None:
    make_location(ctx, "door")
    what = Deletion(MINUTE * 500, MINUTE * 600)

    def run(start: int, work: Callable[[int], Any]) -> None:
        for n in range(start, start + 20):
            work(n)

    with ThreadPoolExecutor(3) as pool:
        posting = pool.submit(run, 0, lambda n: post_states(ctx, "door", [MINUTE * n], [1]))
        mistaken = pool.submit(run, 500, lambda n: post_states(ctx, "door", [MINUTE * n], [0]))
        deleting = pool.submit(run, 500, lambda _: delete_observations(ctx, "door", what))
        for each in (posting, mistaken, deleting):
            each.result(WAIT_S)
    delete_observations(ctx, "door", what)
    assert door_of(ctx, stop=600) == [1] * 20 + [2] * 580
    shown = get_location(ctx, "door")
    assert (shown.observations, shown.first_time, shown.last_time) == (20, 0.0, MINUTE * 19)


def test_where_a_segment_is_damaged_nothing_is_deleted(ctx: Context) -> None:
    make_location(ctx, "lab", (50, 50))
    post_rows(ctx, "lab", [(MINUTE * n, cell, 1) for n in range(4) for cell in (0, 1030)])
    compact_now(ctx)
    damage(ctx, history, chunk=1)
    ctx.caches.histories.drop(lambda _: True)
    post_rows(ctx, "lab", [(MINUTE * 5, 0, 1)])
    with pytest.raises(CorruptChunkError, match="chunk 1, segment 0"):
        delete_observations(ctx, "lab", Deletion(0.0, MINUTE * 9))
    assert history_of(ctx, "lab", 0, 0, 6).states()[0].tolist() == [1, 1, 1, 1, 2, 1]
    assert delete_observations(ctx, "lab", Deletion(MINUTE * 4096, MINUTE * 9999)) == 0
    ctx.store.write(lambda work: work.jobs._connection.execute(history.delete().where(history.c.chunk == 1)))


def test_who_gives_up_has_deleted_nothing(ctx: Context) -> None:
    at_work(ctx, ("spot", 0, 8))
    compact_now(ctx, "door")

    def check() -> None:
        raise ShuttingDownError

    with pytest.raises(ShuttingDownError):
        delete_observations(ctx, "door", Deletion(0.0, MINUTE * 7), check)
    assert door_of(ctx) == [1] * 8 + [2] * 4
    assert not ctx.compacting.locked()


def test_what_cannot_be_is_refused(ctx: Context) -> None:
    with pytest.raises(LocationNotFoundError):
        delete_observations(ctx, "attic", EVER)
    with pytest.raises(InvalidInputError, match="swap them"):
        Deletion(5.0, 4.0)


@WAYS
def test_events_of_what_is_deleted_go_with_it(ctx: Context, compacted: bool) -> None:
    """What lies in the span goes; what reaches out of it ends or begins at its border; what one robot saw stays."""
    make_location(ctx, "door", estimator="static", confidence=0.75)
    post_states(ctx, "door", MINUTE * np.arange(40), np.zeros(40))
    refit(ctx, "door")
    spans = [(100, 103), (108, 112), (120, 121), (128, 134)]
    posts = [post_states(ctx, "door", MINUTE * np.arange(*span), np.ones(span[1] - span[0])) for span in spans]
    numbers = [post.anomalies[0].id for post in posts]
    if compacted:
        compact_now(ctx, "door")
    heard: list[EventMessage] = []
    ctx.bus.subscribe(heard.append)
    assert delete_observations(ctx, "door", Deletion(0, MINUTE * 500, "nobody")) == 0
    assert delete_observations(ctx, "door", Deletion(MINUTE * 110, MINUTE * 130)) == 5
    found = {each.id: (each.start / MINUTE, each.stop / MINUTE) for each in list_events(ctx, EventQuery())}
    assert found == {numbers[0]: (100, 103), numbers[1]: (108, 110), numbers[3]: (130, 134)}
    assert [each.id for each in heard] == [numbers[1], numbers[3]]
    assert get_location(ctx, "door").open_anomalies == 3
