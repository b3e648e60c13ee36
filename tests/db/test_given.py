"""What was read last is kept, and is what history says, whatever comes in, late or not, is compacted or deleted."""

from itertools import count
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.support.contexts import NOW, Clock, compact_now, make_location, opened, post_rows, post_states, refit
from tidemap.history.history import NEVER
from tidemap.services import kept as services_kept
from tidemap.services.compaction import forget
from tidemap.services.context import Context
from tidemap.services.deletion import Deletion, delete_observations
from tidemap.services.given import known_at
from tidemap.services.locations import LocationChanges, change_location, find_location
from tidemap.services.observed import observed_at
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.services.readings import Readings, last_seen, readings_at
from tidemap.services.spectra import fitted
from tidemap.services.state import StateQuery, state_at
from tidemap.storage.records import LocationRecord

SHAPE = (40, 40)
CELLS = (0, 5, 1023, 1024, 1599)
MINUTE = 60.0
BEGIN = NOW - 5000 * MINUTE
STEP = st.one_of(
    st.tuples(
        st.just("post"),
        st.lists(
            st.tuples(st.integers(-100, 300), st.floats(0, 59.9), st.sampled_from(CELLS), st.integers(0, 1)),
            min_size=1,
            max_size=6,
            unique_by=lambda row: (row[0], row[1], row[2]),
        ),
    ),
    st.tuples(
        st.just("go on"),
        st.lists(
            st.tuples(st.sampled_from((1.0, 20.0, 70.0)), st.sampled_from(CELLS[:2]), st.integers(0, 1)),
            min_size=1,
            max_size=6,
        ),
    ),
    st.tuples(st.just("compact"), st.none()),
    st.tuples(st.just("refit"), st.none()),
    st.tuples(st.just("delete"), st.integers(-100, 300)),
    st.tuples(st.just("ask"), st.none()),
)


NAMES = count()


def answers(ctx: Context, name: str) -> list[Any]:
    """The probability of all cells at some times, given what was read last, and when that was."""
    found: list[Any] = []
    for ahead in (-200, 0, 1, 50, 3000):
        time = BEGIN + MINUTE * (150 + ahead)
        view = state_at(ctx, name, StateQuery(time, given="observations", last_seen=True))
        assert view.last_seen is not None
        some = predict_at(ctx, name, PredictQuery([time], view.cell[::2].tolist(), given="observations"))
        np.testing.assert_allclose(some.probability[:, 0], view.probability[::2], atol=1e-6)
        found += [view.cell.tolist(), view.probability.tolist(), np.nan_to_num(view.last_seen).tolist()]
    return found


def compare_observed(name: str, *contexts: Context) -> None:
    """What was last seen, at some times, is what a search through history by the last of them finds."""
    location = find_location(contexts[-1], name)
    assert location.last_time is not None
    for time in (BEGIN, location.last_time - MINUTE, location.last_time, location.last_time + MINUTE, NOW):
        whole = state_at(contexts[-1], name, StateQuery(time)).cell
        found = last_seen(contexts[-1], location, int(location.base.sample(time)), whole)
        for how in ({}, {"order": 1}, {"bbox": (0.0, 0.0, 0.0, 2.0, 20.0, 1.0)}):
            for each in contexts:
                view = state_at(each, name, StateQuery(time, observed=True, **how))
                assert view.observed is not None
                assert view.observed_time is not None
                shown = np.searchsorted(whole, view.cell)
                assert whole[shown].tolist() == view.cell.tolist()
                assert view.observed.tolist() == found.state[shown].tolist()
                sample = found.sample[shown]
                never = sample == NEVER
                assert np.isnan(view.observed_time).tolist() == never.tolist()
                assert view.observed_time[~never].tolist() == location.base.time(sample[~never]).tolist()


def do(ctx: Context, name: str, step: str, what: Any) -> None:
    match step:
        case "post":
            post_rows(ctx, name, [(BEGIN + MINUTE * n + s, cell, state) for n, s, cell, state in what])
        case "go on":
            last = find_location(ctx, name).last_time
            assert last is not None
            times = last + np.cumsum([gap for gap, _, _ in what])
            post_rows(ctx, name, [(time, cell, state) for time, (_, cell, state) in zip(times, what, strict=True)])
        case "compact":
            compact_now(ctx, name)
        case "refit":
            refit(ctx, name)
        case "delete":
            delete_observations(ctx, name, Deletion(BEGIN + MINUTE * what, BEGIN + MINUTE * (what + 5)))


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    steps=st.lists(STEP, min_size=1, max_size=8),
    hold=st.booleans(),
    sensor=st.sampled_from([None, {"miss": 0.1, "false_alarm": 0.2}, "learn"]),
)
def test_what_is_kept_is_what_is_read_anew(
    ctx: Context, database_url: str, steps: list[tuple[str, Any]], hold: bool, sensor: Any
) -> None:
    name, held = f"lab{next(NAMES)}", {"missing": "hold", "hold_s": 600.0} if hold else {}
    make_location(ctx, name, SHAPE, estimator="fft", order=2, sensor=sensor, **held)
    post_rows(ctx, name, [(BEGIN + MINUTE * n, cell, int(n % 20 < 10)) for n in range(100) for cell in CELLS[:4]])
    refit(ctx, name)
    answers(ctx, name)
    with opened(database_url, reading_cache_bytes=0) as forgetful:
        for step, what in steps:
            do(ctx, name, step, what)
            assert answers(ctx, name) == answers(forgetful, name)
            compare_observed(name, ctx, forgetful)


def test_a_post_is_read_and_nothing_else(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    make_location(ctx, "lab", SHAPE, estimator="static")
    post_rows(ctx, "lab", [(BEGIN + MINUTE * n, cell, n % 2) for n in range(10) for cell in CELLS])
    refit(ctx, "lab")
    answers(ctx, "lab")
    asked: list[list[int]] = []

    def counted(ctx: Context, location: LocationRecord, moment: float, cells: NDArray[np.int64]) -> Readings:
        asked.append(cells.tolist())
        return readings_at(ctx, location, moment, cells)

    monkeypatch.setattr(services_kept, "readings_at", counted)
    post_rows(ctx, "lab", [(BEGIN + MINUTE * 11, cell, 1) for cell in (5, 1599)])
    answers(ctx, "lab")
    assert not asked, "what is later than all before needs no history"
    post_rows(ctx, "lab", [(BEGIN + MINUTE * 10, cell, 0) for cell in (5, 1599)])
    before = answers(ctx, "lab")
    assert asked == [[5, 1599]]
    assert answers(ctx, "lab") == before
    assert asked == [[5, 1599]]
    # As of an earlier moment history is asked.
    state_at(ctx, "lab", StateQuery(NOW, given="observations", as_of=BEGIN + MINUTE * 5))
    assert asked[1:] == [list(CELLS)]


def test_what_is_read_after_the_moment_is_not_known(ctx: Context) -> None:
    make_location(ctx, "door", estimator="static")
    post_states(ctx, "door", [BEGIN + 10.0, BEGIN + 70.0, BEGIN + 130.0], [0, 1, 1])
    refit(ctx, "door")

    def p(time: float, as_of: float) -> float:
        query = StateQuery(BEGIN + time, given="observations", as_of=BEGIN + as_of)
        return float(state_at(ctx, "door", query).probability[0])

    model = float(state_at(ctx, "door", StateQuery(BEGIN)).probability[0])
    assert p(200.0, 9.9) == p(200.0, -1e6) == model, "nothing was read by then"
    assert p(200.0, 10.0) < model < p(200.0, 70.0) < p(200.0, 130.0)
    assert p(200.0, 69.9) == p(200.0, 10.0), "what was read later in the sample is not known yet"
    assert p(10.0, 10.0) == p(5.0, 10.0) == model, "it is not later than the reading"
    assert p(10.1, 10.0) < model


def test_observed_reads_no_history_but_of_what_was_posted(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    make_location(ctx, "lab", SHAPE, estimator="static")
    post_rows(ctx, "lab", [(BEGIN + MINUTE * n, cell, n % 2) for n in range(10) for cell in CELLS])
    refit(ctx, "lab")
    view = state_at(ctx, "lab", StateQuery(BEGIN + MINUTE * 10, observed=True))
    assert view.observed is not None
    assert view.observed.tolist() == [1] * 5
    post_rows(ctx, "lab", [(BEGIN + MINUTE * 11, 5, 0)])
    asked: list[list[int]] = []

    def counted(ctx: Context, location: LocationRecord, moment: float, cells: NDArray[np.int64]) -> Readings:
        asked.append(cells.tolist())
        return readings_at(ctx, location, moment, cells)

    monkeypatch.setattr(services_kept, "readings_at", counted)
    monkeypatch.setattr("tidemap.services.observed.last_seen", lambda *_: pytest.fail("history was searched"))
    for time in (BEGIN + MINUTE * 11, NOW, NOW + 1e6):
        view = state_at(ctx, "lab", StateQuery(time, observed=True, order=0))
        assert view.observed is not None
        assert view.observed.tolist() == [1, 0, 1, 1, 1]
    assert not asked


def test_a_state_that_flickers_in_one_sample_needs_no_history(
    ctx: Context, database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_location(ctx, "lab", SHAPE, estimator="static")
    post_rows(ctx, "lab", [(BEGIN + MINUTE * n, cell, n // 4 % 2) for n in range(10) for cell in CELLS])
    refit(ctx, "lab")
    answers(ctx, "lab")
    with opened(database_url, reading_cache_bytes=0) as forgetful:
        with monkeypatch.context() as patched:
            patched.setattr(services_kept, "readings_at", lambda *_: pytest.fail("history was read"))
            known = []
            for second, state in enumerate((1, 0, 1, 1, 0, 0, 1)):
                post_rows(ctx, "lab", [(BEGIN + MINUTE * 11 + second, cell, state) for cell in (5, 1599)])
                known.append(answers(ctx, "lab"))
        assert known[-1] == answers(forgetful, "lab")
        post_rows(ctx, "lab", [(BEGIN + MINUTE * 11 + 10, 5, 0)])
        assert answers(ctx, "lab") == answers(forgetful, "lab") != known[-1]


def test_neither_a_compaction_nor_an_update_makes_what_is_kept_be_read_anew(
    ctx: Context, database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_location(ctx, "lab", SHAPE, estimator="fft", order=2)
    post_rows(ctx, "lab", [(BEGIN + MINUTE * n, cell, n // 4 % 2) for n in range(100) for cell in CELLS])
    refit(ctx, "lab")
    before = answers(ctx, "lab")
    with monkeypatch.context() as patched:
        patched.setattr(services_kept, "readings_at", lambda *_: pytest.fail("history was read"))
        post_rows(ctx, "lab", [(BEGIN + MINUTE * 101, cell, 1) for cell in (5, 1599)])
        compact_now(ctx, "lab")
        between = answers(ctx, "lab")
        post_rows(ctx, "lab", [(BEGIN + MINUTE * 102, cell, 0) for cell in (5, 1024)])
        refit(ctx, "lab")
        after = answers(ctx, "lab")
    assert before != between != after
    with opened(database_url, reading_cache_bytes=0) as forgetful:
        assert after == answers(forgetful, "lab")


def test_what_is_forgotten_is_not_observed(ctx: Context, clock: Clock) -> None:
    make_location(ctx, "lab", SHAPE, estimator="static", retention=3600.0)
    post_rows(ctx, "lab", [(NOW - 3000.0, 5, 1), (NOW - 60.0, 0, 1)])
    refit(ctx, "lab")
    compare_observed("lab", ctx)
    clock.now = NOW + 1800.0
    post_rows(ctx, "lab", [(clock.now, 0, 0)])
    compact_now(ctx, "lab")
    forget(ctx, find_location(ctx, "lab"))
    compare_observed("lab", ctx)
    view = state_at(ctx, "lab", StateQuery(clock.now, observed=True))
    assert view.observed is not None
    assert dict(zip(view.cell.tolist(), view.observed.tolist(), strict=True)) == {0: 0, 5: 2}


def test_what_is_older_than_the_model_reaches_is_not_observed(database_url: str) -> None:
    with opened(database_url, max_samples=100) as ctx:
        make_location(ctx, "lab", SHAPE, estimator="static")
        post_rows(ctx, "lab", [(BEGIN + MINUTE * n, cell, 1) for n in (-9000, -8910) for cell in (0, 5)])
        refit(ctx, "lab")
        compare_observed("lab", ctx)
        post_rows(ctx, "lab", [(BEGIN, 0, 0)])
        compare_observed("lab", ctx)
        view = state_at(ctx, "lab", StateQuery(NOW, observed=True))
        assert view.observed is not None
        assert view.observed.tolist() == [0, 2]


def test_each_of_a_few_cells_keeps_its_state_for_as_long_as_it_does(ctx: Context, database_url: str) -> None:
    make_location(ctx, "rooms", (2, 2), estimator="static")
    states = np.array([np.arange(4000) // length % 2 for length in (3, 3, 200, 200)])
    rows = [(BEGIN + MINUTE * n, cell, int(states[cell, n])) for n in range(4000) for cell in range(4)]
    post_rows(ctx, "rooms", rows)
    offset = refit(ctx, "rooms").offset
    assert offset[0] < 0 < offset[3]
    last = BEGIN + MINUTE * 3999
    with opened(database_url) as again:
        for each in (ctx, again):
            view = state_at(each, "rooms", StateQuery(last + 30 * MINUTE, given="observations"))
            sure = np.abs(view.probability - 0.5)
            assert sure[2:].min() > sure[:2].max() + 0.1
            twice = PredictQuery([last + 30 * MINUTE], [3, 0, 3], given="observations")
            assert predict_at(each, "rooms", twice).probability[:, 0].tolist() == view.probability[[3, 0, 3]].tolist()


def test_what_is_compacted_meanwhile_is_read_from_the_history(ctx: Context) -> None:
    make_location(ctx, "lab", SHAPE, estimator="static")
    post_rows(ctx, "lab", [(BEGIN + MINUTE * n, cell, n % 2) for n in range(10) for cell in CELLS])
    refit(ctx, "lab")
    cells = np.array(sorted(CELLS))
    known_at(ctx, fitted(ctx, "lab"), cells, NOW)
    post_rows(ctx, "lab", [(BEGIN + MINUTE * 11, 5, 0)])
    before = fitted(ctx, "lab")
    compact_now(ctx, "lab")
    found, fresh = known_at(ctx, before, cells, NOW), known_at(ctx, fitted(ctx, "lab"), cells, NOW)
    assert found.evidence.sample.tolist() == fresh.evidence.sample.tolist()


def test_beliefs_follow_a_change_of_hold(ctx: Context, database_url: str) -> None:
    make_location(
        ctx, "door", estimator="static", missing="hold", hold_s=3600, sensor={"miss": 0.1, "false_alarm": 0.1}
    )
    post_states(ctx, "door", BEGIN + MINUTE * np.arange(100), np.arange(100) % 40 < 20)
    refit(ctx, "door")
    query = StateQuery(BEGIN + MINUTE * 150, as_of=BEGIN + MINUTE * 149)
    state_at(ctx, "door", query)
    change_location(ctx, "door", LocationChanges(hold_s=60.0))
    with opened(database_url) as again:
        assert state_at(ctx, "door", query).probability == state_at(again, "door", query).probability


def test_what_comes_in_during_a_question_is_for_the_next_one(ctx: Context) -> None:
    make_location(ctx, "lab", SHAPE, estimator="static")
    post_rows(ctx, "lab", [(BEGIN + MINUTE * n, cell, n % 2) for n in range(10) for cell in CELLS])
    refit(ctx, "lab")
    before = fitted(ctx, "lab")
    post_rows(ctx, "lab", [(NOW - MINUTE, 5, 1)])
    seen = observed_at(ctx, before, np.array(sorted(CELLS)), NOW - 10 * MINUTE)
    assert seen.sample.max() < before.location.base.sample(NOW - 10 * MINUTE)
