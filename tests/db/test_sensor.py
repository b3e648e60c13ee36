"""A location whose sensor errs: what is believed of it, as it was known at a moment."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.contexts import NOW, compact_now, make_location, opened, post_rows, post_states, refit
from tests.unit.spectral.filtering import filtered, learn
from tests.unit.spectral.real import room
from tidemap.api.views.locations import location_changes
from tidemap.formats.registry import Body
from tidemap.history.history import UNOBSERVED
from tidemap.history.sequences import Sequences
from tidemap.media_types import JSON
from tidemap.schemas.locations import LocationPatch
from tidemap.services import beliefs as services_beliefs
from tidemap.services.context import Context
from tidemap.services.locations import change_location
from tidemap.services.model import model_of
from tidemap.services.observe import observe
from tidemap.services.posts import Post
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.services.state import StateQuery, ask, buffer_of, grid_of, state_at
from tidemap.spectral.prediction import predict_readings
from tidemap.spectral.sensor import Sensor

MINUTE = 60.0
BEGIN = NOW - 5000 * MINUTE
RATES = {"miss": 0.2, "false_alarm": 0.2}


def probability(ctx: Context, name: str, time: float, as_of: float | None = None) -> float:
    query = StateQuery(time, given="observations", as_of=as_of)
    return float(state_at(ctx, name, query).probability[0])


def noisy(n: int, seed: int = 0) -> NDArray[np.uint8]:
    """An hour occupied, an hour free, read with one error in five."""
    truth = np.arange(n) // 60 % 2 == 0
    return np.asarray(truth ^ (np.random.default_rng(seed).random(n) < 0.2), np.uint8)


def door(ctx: Context, n: int = 2000, **form: Any) -> float:
    """A door that was read every minute; when it was read last."""
    make_location(ctx, "door", estimator="static", **form)
    post_states(ctx, "door", BEGIN + MINUTE * np.arange(n), noisy(n))
    refit(ctx, "door")
    return BEGIN + MINUTE * (n - 1)


def test_one_false_reading_is_not_believed_and_several_are(ctx: Context) -> None:
    last = door(ctx, 2010, sensor=RATES)
    before = probability(ctx, "door", last + 1)
    post_states(ctx, "door", [last + MINUTE], [before < 0.5])
    once = probability(ctx, "door", last + MINUTE + 1)
    assert (once < 0.5) == (before < 0.5)
    post_states(ctx, "door", last + MINUTE * np.arange(2, 9), [before < 0.5] * 7)
    assert (probability(ctx, "door", last + 9 * MINUTE) < 0.5) != (before < 0.5)
    # As of then it is as it was then.
    assert probability(ctx, "door", last + MINUTE + 1, last + MINUTE + 1) == once


@pytest.mark.parametrize(("time", "as_of"), [(-30 * MINUTE, None), (3000 * MINUTE, -MINUTE)], ids=["past", "early"])
def test_before_any_reading_it_is_the_rhythm_of_the_state(ctx: Context, time: float, as_of: float | None) -> None:
    door(ctx, sensor={"miss": 0.1, "false_alarm": 0.3})
    moment = None if as_of is None else BEGIN + as_of
    query = StateQuery(BEGIN + time, given="observations", as_of=moment)
    read = state_at(ctx, "door", replace(query, given="model")).probability
    expected = Sensor(0.1, 0.3).state_probability(read).astype(np.float32)
    assert abs(expected - read) > 0.05
    asked = ask(ctx, "door", query)
    buffered = buffer_of(ctx, asked)
    assert buffered is not None
    predicted = predict_at(ctx, "door", PredictQuery([query.time], given="observations", as_of=moment))
    for found in (
        state_at(ctx, "door", query).probability,
        grid_of(ctx, asked),
        predicted.probability[0],
        buffered.lease.value.arrow.columns["probability"],
    ):
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(grid_of(ctx, ask(ctx, "door", replace(query, given="model", last_seen=True))), read)


def test_late_readings_change_the_answer(ctx: Context) -> None:
    make_location(ctx, "door", estimator="static", sensor=RATES)
    post_states(ctx, "door", BEGIN + MINUTE * np.arange(0, 400, 2), noisy(400)[::2])
    refit(ctx, "door")
    last = BEGIN + 398 * MINUTE
    before = probability(ctx, "door", last + 1)
    post_states(ctx, "door", last - MINUTE * np.arange(1, 20, 2), np.ones(10))
    assert probability(ctx, "door", last + 1) > before


def test_what_a_sensor_is_worth_can_be_changed_at_any_time(ctx: Context) -> None:
    last = door(ctx)
    true = probability(ctx, "door", last + 1)
    for sensor, doubted in (({"miss": 0.4, "false_alarm": 0.4}, True), ("learn", False), (None, False)):
        change_location(ctx, "door", location_changes(LocationPatch.model_validate({"sensor": sensor})))
        found = probability(ctx, "door", last + 1)
        assert (abs(found - true) > 0.01) == doubted, "nothing was learned yet"
    change_location(ctx, "door", {"sensor": "learn"})
    refit(ctx, "door")
    assert abs(probability(ctx, "door", last + 1) - true) > 0.01


def test_what_is_learned_is_shown_and_stored(ctx: Context, database_url: str) -> None:
    last = door(ctx, 4000, sensor="learn")
    with opened(database_url) as again:
        found = model_of(again, "door").revision.detector
        assert found is not None
        assert found.sensor.miss == pytest.approx(0.2, abs=0.03)
        assert found.sensor.false_alarm == pytest.approx(0.2, abs=0.03)
        assert found.reason == "the rates were learned from 4000 readings of 1 cell"
        assert probability(again, "door", last + 30) == probability(ctx, "door", last + 30)


def test_what_is_held_is_no_evidence_of_a_sensor(ctx: Context) -> None:
    make_location(ctx, "bell", estimator="static", missing="hold", hold_s=1800.0, sensor="learn")
    post_states(ctx, "bell", BEGIN + MINUTE * np.arange(0, 4800, 12), noisy(400))
    refit(ctx, "bell")
    found = model_of(ctx, "bell").revision.detector
    assert found is not None
    assert found.readings == 400


@pytest.mark.parametrize("compacted", [False, True])
def test_a_belief_is_held_until_its_sensor_says_that_it_is_unavailable(ctx: Context, compacted: bool) -> None:
    """As if a state stood that long and no longer; readings that follow move what is believed without any hold."""
    n, gap = 300, 200
    times = BEGIN + MINUTE * np.append(np.arange(n), n + gap + np.arange(3))
    states = np.append(noisy(n), [0, 1, 1])
    for name, hold_s in (("ended", 4 * gap * MINUTE), ("short", 4 * MINUTE), ("long", 4 * gap * MINUTE)):
        make_location(ctx, name, estimator="static", missing="hold", hold_s=4 * MINUTE, sensor=RATES)
        post_states(ctx, name, times[:n], states[:n])
        refit(ctx, name)
        # All have the same model.
        change_location(ctx, name, {"hold_s": hold_s})
        probability(ctx, name, times[n - 1] + 1)
    body = Body(b'{"time": [%f], "state": [null]}' % (times[n - 1] + 5 * MINUTE), JSON)
    observe(ctx, "ended", Post(body))
    found, later = {}, {}
    for name in ("ended", "short", "long"):
        if compacted:
            compact_now(ctx, name)
        found[name] = [probability(ctx, name, times[n - 1] + minutes * MINUTE + 1) for minutes in (3, 100, gap)]
        post_states(ctx, name, times[n:], states[n:])
        later[name] = [probability(ctx, name, time + 1, time + 1) for time in times[-3:]]
    assert found["ended"] == found["short"]
    assert found["ended"][1:] != found["long"][1:]
    assert later["ended"] == later["short"] == later["long"]


def test_posts_are_gone_on_from_and_not_read_anew(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    make_location(ctx, "lab", (40, 40), estimator="static", sensor=RATES)
    rows = [(BEGIN + MINUTE * n, cell, n // 10 % 2) for n in range(100) for cell in (3, 1500)]
    post_rows(ctx, "lab", rows)
    refit(ctx, "lab")
    state_at(ctx, "lab", StateQuery(NOW, given="observations"))
    read: list[int] = []

    def counted(spectrum: Any, cells: Any, sequences: Sequences, base: Any) -> NDArray[np.float32]:
        read.append(len(sequences.sample))
        return predict_readings(spectrum, cells, sequences, base)

    monkeypatch.setattr(services_beliefs, "predict_readings", counted)
    post_rows(ctx, "lab", [(BEGIN + MINUTE * 100, 3, 1), (BEGIN + MINUTE * 101, 3, 1)])
    state_at(ctx, "lab", StateQuery(NOW, given="observations"))
    assert read == [2]
    compact_now(ctx, "lab")
    post_rows(ctx, "lab", [(BEGIN + MINUTE * 50.5, 3, 1)])
    state_at(ctx, "lab", StateQuery(NOW, given="observations"))
    assert read == [2, 102], "late ones are"


def test_a_long_history_is_filtered_from_its_latest_readings(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    last = door(ctx, 4800, sensor=RATES)
    whole = probability(ctx, "door", last + 1)
    monkeypatch.setattr(services_beliefs, "MAX_READINGS", 200)
    assert probability(ctx, "door", last + 1, last) == pytest.approx(whole, abs=0.02)


def test_things_in_a_room(ctx: Context) -> None:
    """Through the services, rates learned, it is the same as by the core, whose scores other tests have."""
    past, now = room("train"), room("test")
    shape, base = (2, 4), BEGIN
    make_location(ctx, "room", shape, interval_s=0.5, epoch=base, sensor="learn")
    for start, things in ((base, past), (base + 3 * 3600, now)):
        states = things.read.states()
        cell, sample = np.nonzero(states != UNOBSERVED)
        order = np.argsort(sample, kind="stable")
        times = start + 0.5 * sample[order]
        post_rows(
            ctx, "room", zip(times.tolist(), cell[order].tolist(), states[cell, sample][order].tolist(), strict=True)
        )
        if things is past:
            refit(ctx, "room")
    expected = filtered(learn(past, None), now, 400)
    for column in range(1, expected.shape[1]):
        moment = base + 3 * 3600 + 200.0 * column + 0.1
        query = PredictQuery([moment], list(range(8)), as_of=moment, given="observations")
        found = predict_at(ctx, "room", query).probability[:, 0]
        np.testing.assert_allclose(found, expected[:, column], atol=0.01)
