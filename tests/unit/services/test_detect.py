"""Searching the history for anomalies, and the events that were stored."""

import numpy as np
import pytest

from tests.support.contexts import make_location, post_rows, post_states, refit
from tests.support.truth import share
from tidemap.errors import AnomalyNotFoundError, InvalidInputError, LocationNotFoundError, NoModelError
from tidemap.services import detect as detect_module
from tidemap.services.acknowledging import acknowledge
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.detect import DetectQuery, detect
from tidemap.services.locations import delete_location
from tidemap.spectral.anomaly import Rule

MINUTE = 60.0


def make_lab(ctx: Context) -> np.ndarray:
    """Cells of two chunks, mostly free, each now and then occupied or not seen; their states (cells, minutes)."""
    make_location(ctx, "lab", (40, 40), confidence=0.6, estimator="static")
    chance = np.random.default_rng(3)
    states = np.full((1600, 30), 2)
    cells = chance.choice(1600, 200, replace=False)
    states[cells] = chance.choice([0, 1, 2], (200, 30), p=[0.8, 0.1, 0.1])
    rows = [(MINUTE * n, cell, states[cell, n]) for cell in cells.tolist() for n in range(30) if states[cell, n] < 2]
    post_rows(ctx, "lab", [(time, cell, int(state)) for time, cell, state in rows])
    refit(ctx, "lab")
    return states


@pytest.mark.parametrize("rule", ["surprise", "paper"])
@pytest.mark.parametrize(("start", "stop"), [(0.0, MINUTE * 30), (MINUTE * 7, MINUTE * 12 + 1), (-1e9, 1e9)])
@pytest.mark.parametrize("block", [1, 1 << 22])
def test_the_events_are_all_that_the_rule_says(
    ctx: Context, monkeypatch: pytest.MonkeyPatch, rule: Rule, start: float, stop: float, block: int
) -> None:
    monkeypatch.setattr(detect_module, "BLOCK_VALUES", block)
    states = make_lab(ctx)
    events, revision = detect(ctx, "lab", DetectQuery(start, stop, rule=rule))
    seen = states < 2
    counts = np.maximum(seen.sum(axis=1, keepdims=True), 1)
    p = (states == 1).sum(axis=1, keepdims=True) / counts
    wrong = np.abs(p - states) > 0.6 if rule == "surprise" else (p > 0.6) != (states == 1)
    minute = np.arange(30) * MINUTE
    expected = {
        (cell, n, states[cell, n])
        for cell, n in np.argwhere(wrong & seen & (minute + MINUTE > start) & (minute < stop)).tolist()
    }
    found = {
        (cell, n, event.observed)
        for event in events
        for cell in event.cells
        for n in range(int(event.start // MINUTE), int(event.stop // MINUTE))
        if (cell, n, event.observed) in expected
    }
    assert found == expected
    for event in events:
        minutes = range(int(event.start // MINUTE), int(event.stop // MINUTE))
        assert all(any((cell, n, event.observed) in expected for n in minutes) for cell in event.cells)
    assert revision == 1
    assert sum(event.stop - event.start == MINUTE for event in events) > 0
    assert {(event.id, event.rule, event.confidence) for event in events} == {(0, rule, 0.6)}
    assert [event.start for event in events] == sorted(event.start for event in events)
    assert list_events(ctx, EventQuery()) == []


def test_an_event_tells_its_cells_and_how_surprising_they_were(ctx: Context) -> None:
    make_location(ctx, "lab", (6, 6))
    rows = [(MINUTE * n, cell, int((cell, n) in {(7, 5), (8, 5), (8, 6)})) for n in range(10) for cell in (7, 8)]
    post_rows(ctx, "lab", rows)
    refit(ctx, "lab", estimator="static")
    ((event,), _) = detect(ctx, "lab", DetectQuery(0.0, 600.0, confidence=0.7))
    assert (event.start, event.stop, event.cells.tolist(), event.observed) == (300.0, 420.0, [7, 8], 1)
    assert event.probability == pytest.approx((share(1, 10) + 2 * share(2, 10)) / 3)
    assert event.surprise == pytest.approx(1 - share(1, 10))


def test_too_many_marks_are_refused_before_they_fill_the_memory(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted over all chunks together."""
    make_lab(ctx)
    monkeypatch.setattr(detect_module, "MAX_MARKS", 5)
    with pytest.raises(InvalidInputError, match="search a shorter time"):
        detect(ctx, "lab", DetectQuery(0.0, 1e9))


def test_what_cannot_be_searched_is_refused(ctx: Context) -> None:
    make_location(ctx, "door")
    with pytest.raises(NoModelError):
        detect(ctx, "door", DetectQuery(0.0, 1.0))
    with pytest.raises(InvalidInputError, match="before start"):
        detect(ctx, "door", DetectQuery(1.0, 0.0))
    post_states(ctx, "door", [0.0], [1])
    refit(ctx, "door")
    assert detect(ctx, "door", DetectQuery(1e6, 2e6)) == ([], 1)


def test_events_are_listed_by_location_and_acknowledged(ctx: Context) -> None:
    for name in ("door", "gate"):
        make_location(ctx, name)
        post_states(ctx, name, MINUTE * np.arange(50), np.zeros(50))
        refit(ctx, name, estimator="static")
    post_states(ctx, "door", [6000.0], [1])
    post_states(ctx, "gate", [6000.0], [1])
    assert [(event.id, event.location) for event in list_events(ctx, EventQuery())] == [(1, "door"), (2, "gate")]
    assert [event.id for event in list_events(ctx, EventQuery("gate"))] == [2]
    with pytest.raises(LocationNotFoundError):
        list_events(ctx, EventQuery("attic"))
    event = acknowledge(ctx, 2, "ann", "a cat")
    assert (event.location, event.acknowledged_by, event.note) == ("gate", "ann", "a cat")
    assert [each.id for each in list_events(ctx, EventQuery(acknowledged=True))] == [event.id]
    delete_location(ctx, "gate")
    with pytest.raises(AnomalyNotFoundError):
        acknowledge(ctx, 2, "ann", None)
    assert [event.id for event in list_events(ctx, EventQuery())] == [1]
