"""How several measurements of a sample make its state, from the post to the prediction."""

from typing import Any

import numpy as np
import pytest

from tests.support.contexts import NOW, compact_now, history_of, make_location, opened, post_states, refit
from tidemap.api.views.locations import location_changes
from tidemap.errors import InvalidInputError
from tidemap.schemas.locations import LocationPatch
from tidemap.services.context import Context
from tidemap.services.deletion import Deletion, delete_observations
from tidemap.services.locations import LocationChanges, change_location, get_location
from tidemap.services.predict import PredictQuery, predict_at

HOUR, DAY = 3600.0, 86_400.0


def pulses() -> tuple[Any, Any]:
    """4,248 detections of 10 s in 14 days, between 7 and 19 o'clock, with 0 sent after each."""
    start = NOW - NOW % DAY - 14 * DAY
    n = 4248
    day, within = np.arange(n) % 14, np.arange(n) // 14
    begin = start + day * DAY + 7 * HOUR + within * (12 * HOUR / (n // 14 + 1)) + 5.0
    return np.ravel([begin, begin + 10.0]), np.repeat([1, 0], n)


def p_noon(ctx: Context, **form: Any) -> float:
    make_location(ctx, "hall", interval_s=HOUR, estimator="calendar", **form)
    time, state = pulses()
    post_states(ctx, "hall", time, state)
    # Nothing between detections says that the hall is empty at night: its sensor reports that, once an hour.
    nights = NOW - NOW % DAY - HOUR * np.arange(14 * 24) - 1.0
    nights = nights[(nights % DAY < 7 * HOUR) | (nights % DAY >= 19 * HOUR)]
    post_states(ctx, "hall", nights, np.zeros(len(nights)))
    refit(ctx, "hall")
    noon = NOW - NOW % DAY + DAY + 12 * HOUR + 60.0
    return float(predict_at(ctx, "hall", PredictQuery([noon], [0])).probability[0, 0])


def test_short_pulses_are_seen_by_any(ctx: Context) -> None:
    assert p_noon(ctx, combine="any") > 0.95


def test_and_not_by_the_latest(ctx: Context) -> None:
    assert p_noon(ctx) < 0.1


@pytest.mark.parametrize(("combine", "states"), [("latest", [0, 1]), ("any", [1, 1]), ("majority", [1, 0])])
def test_what_a_sample_is(ctx: Context, combine: Any, states: list[int]) -> None:
    make_location(ctx, "door", combine=combine)
    post_states(ctx, "door", [0.0, 10.0, 20.0, 70.0], [1, 1, 0, 0])
    compact_now(ctx, "door")
    post_states(ctx, "door", [80.0, 90.0], [0, 1])
    assert history_of(ctx, "door", 0, 0, 2).states()[0].tolist() == states
    compact_now(ctx, "door")
    assert history_of(ctx, "door", 0, 0, 2).states()[0].tolist() == states


def test_a_free_measurement_is_no_surprise_where_any_occupied_one_counts(ctx: Context) -> None:
    for name, combine in (("first", "latest"), ("second", "any")):
        make_location(ctx, name, combine=combine, estimator="static")
        post_states(ctx, name, NOW - 60.0 * np.arange(200), np.ones(200))
        refit(ctx, name)
    assert len(post_states(ctx, "first", [NOW + 60.0], [0]).anomalies) == 1
    assert post_states(ctx, "second", [NOW + 60.0], [0]).anomalies == []


def test_it_changes_only_while_nothing_has_been_combined(ctx: Context) -> None:
    make_location(ctx, "door")
    assert change_location(ctx, "door", LocationChanges(combine="any")).combine == "any"
    post_states(ctx, "door", [0.0, 10.0], [1, 0])
    assert change_location(ctx, "door", LocationChanges(combine="any", confidence=0.8)).confidence == 0.8
    with pytest.raises(InvalidInputError, match=r"combined by 'any', which cannot be taken apart"):
        change_location(ctx, "door", LocationChanges(combine="majority", confidence=0.7))
    assert (get_location(ctx, "door").combine, get_location(ctx, "door").confidence) == ("any", 0.8)
    delete_observations(ctx, "door", Deletion(0.0, 60.0))
    assert change_location(ctx, "door", LocationChanges(combine="majority")).combine == "majority"
    with pytest.raises(InvalidInputError, match="null is no value"):
        change_location(ctx, "door", location_changes(LocationPatch(combine=None)))


def test_locations_that_were_there_before_go_on_as_they_did(database_url: str) -> None:
    with opened(database_url) as ctx:
        assert make_location(ctx, "door").combine == "latest"
