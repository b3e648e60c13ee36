"""The paper's office week as events: its openings in the evening and at night, each with its own bounds."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.contexts import make_location, post_states, refit
from tests.support.office import Office
from tidemap.services.anomalies import Anomaly, EventQuery, list_events
from tidemap.services.confidence import find_confidence
from tidemap.services.context import Context
from tidemap.services.detect import DetectQuery, detect
from tidemap.services.spectra import fitted
from tidemap.spectral.prediction import predict_times

CONFIDENCE = 0.95
DAY_S = 86400
Bounds = tuple[float, float]


def runs(flags: NDArray[np.bool_]) -> list[Bounds]:
    """[start, stop) of what is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(float(start), float(stop)) for start, stop in edges.reshape(-1, 2)]


def learned(ctx: Context, office: Office) -> list[Bounds]:
    """A door that has the week and a model of it; the stretches of its openings that were surprising."""
    make_location(ctx, "door", interval_s=1.0, confidence=CONFIDENCE)
    for part in np.array_split(np.arange(len(office.week.state)), 7):
        post_states(ctx, "door", office.week.time_s[part], office.week.state[part])
    refit(ctx, "door", estimator="fft", order=15)
    p = predict_times(fitted(ctx, "door").spectrum, office.week.time_s)[0]
    return runs((1 - p > CONFIDENCE) & (office.week.state == 1))


def bounds(events: list[Anomaly]) -> list[Bounds]:
    """Of the openings."""
    return [(event.start, event.stop) for event in events if event.observed]


def apart(openings: list[Bounds]) -> None:
    """In the evening and at night, and each an event of its own."""
    assert len(openings) == 7
    assert all(start % DAY_S >= 17 * 3600 or start % DAY_S < 7 * 3600 for start, _ in openings)


@pytest.mark.slow
def test_a_search_finds_each_opening(ctx: Context, office: Office) -> None:
    openings = learned(ctx, office)
    events, _ = detect(ctx, "door", DetectQuery(0, 7 * DAY_S))
    apart(bounds(events))
    assert bounds(events) == openings
    assert len(events) == 44


@pytest.mark.slow
def test_posts_of_a_minute_make_the_same_events(ctx: Context, office: Office) -> None:
    """Around each opening, minute by minute: the week as if it came again."""
    openings = learned(ctx, office)
    time, state = office.week.time_s, office.week.state
    for start, stop in openings:
        for begin in range(int(start) - 90, int(stop) + 90, 60):
            part = slice(begin, min(begin + 60, len(time)))
            post_states(ctx, "door", time[part], state[part])
    events = [event for event in list_events(ctx, EventQuery(limit=None)) if event.observed]
    assert sorted((event.start, event.stop) for event in events) == openings


@pytest.mark.slow
def test_the_helper_gives_few_false_events(ctx: Context, office: Office) -> None:
    learned(ctx, office)
    assert not find_confidence(ctx, "door", 1.0).reached, "what is clipped to 0 and 1 is sure of too much"
    refit(ctx, "door")
    found = find_confidence(ctx, "door", 1.0)
    events, _ = detect(ctx, "door", DetectQuery(0, 7 * DAY_S, confidence=found.confidence))
    assert found.reached
    assert len(events) <= 1
