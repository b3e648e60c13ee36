"""What looking is expected to say, of stored locations: it is what the probability of the state says."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.contexts import NOW, make_location, post_rows, post_states, refit
from tidemap.errors import AskerLeftError, InvalidInputError
from tidemap.services.context import Context
from tidemap.services.given import Given
from tidemap.services.information import InformationQuery, information_at
from tidemap.services.state import StateQuery, state_at
from tidemap.spectral.information import ErrorRates, information
from tidemap.spectral.sensor import Sensor

MINUTE = 60.0
BEGIN = NOW - 300 * MINUTE
CELLS = (3, 700, 1030, 1599)
BOX = (0.0, 0.0, 0.0, 9.0, 20.0, 1.0)


def make_lab(ctx: Context) -> str:
    """A grid of two chunks; a few cells are occupied in the first half of every twenty minutes, one always."""
    make_location(ctx, "lab", (40, 40))
    rows = [(BEGIN + MINUTE * n, cell, int(n % 20 < 10)) for n in range(200) for cell in CELLS[:3]]
    post_rows(ctx, "lab", rows + [(BEGIN + MINUTE * n, CELLS[3], 1) for n in range(200)])
    refit(ctx, "lab", estimator="fft", order=2)
    return "lab"


def test_it_is_what_the_states_probability_says(ctx: Context) -> None:
    name = make_lab(ctx)

    @settings(max_examples=25, deadline=None)
    @given(
        minutes=st.floats(-100, 1000),
        as_of=st.floats(-10, 400),
        conditioned=st.sampled_from(["observations", "model"]),
        boxed=st.booleans(),
        look=st.sampled_from([ErrorRates(), ErrorRates(0.1, 0.2)]),
    )
    def holds(minutes: float, as_of: float, conditioned: Given, boxed: bool, look: ErrorRates) -> None:
        asked = {"as_of": BEGIN + as_of * MINUTE, "given": conditioned, "bbox": BOX if boxed else None}
        compare(ctx, name, BEGIN + minutes * MINUTE, look, asked)

    holds()


def compare(ctx: Context, name: str, time: float, look: ErrorRates, asked: dict[str, Any]) -> None:
    """The answer for one time, and that for a window, with the state's probability."""
    state = state_at(ctx, name, StateQuery(time, **asked))
    how = {"miss": look.miss, "false_alarm": look.false_alarm, **asked}
    one = information_at(ctx, name, InformationQuery(time=time, **how))
    assert one.cells is not None
    assert one.cells.cell.tolist() == state.cell.tolist() == list(CELLS[: 4 if asked["bbox"] is None else 2])
    expected = information(state.probability, look)
    np.testing.assert_allclose(one.cells.information, expected, atol=1e-5)
    assert ((one.cells.information >= 0) & (one.cells.information <= math.log(2))).all()
    assert one.information[0] == pytest.approx(one.cells.information.sum())
    assert one.entropy[0] == pytest.approx(one.cells.entropy.sum())
    assert (one.as_of, one.given, one.revision, one.n_cells) == (asked["as_of"], asked["given"], 1, len(expected))
    window = information_at(ctx, name, InformationQuery(start=time, stop=time + 90.0, step=60.0, **how))
    assert window.time.tolist() == [time, time + 60.0]
    assert window.cells is None
    assert window.information[0] == pytest.approx(one.information[0], abs=1e-5)


def test_a_look_that_was_just_made_leaves_little_to_see(ctx: Context) -> None:
    make_location(ctx, "door", estimator="static")
    post_states(ctx, "door", [BEGIN + MINUTE * n for n in range(300)], [n // 30 % 2 for n in range(300)])
    refit(ctx, "door")
    ahead = information_at(ctx, "door", InformationQuery(start=NOW, stop=NOW + 3600.0, step=60.0, best=3))
    assert (np.diff(ahead.information) > 0).all(), "the longer ago, the more there is to see"
    rhythm = information_at(ctx, "door", InformationQuery(start=NOW, stop=NOW + 3600.0, step=60.0, given="model"))
    assert (ahead.information < rhythm.information).all()
    assert ahead.best[0] == len(ahead.time) - 1
    assert (np.abs(np.diff(ahead.time[np.sort(ahead.best)])) >= ahead.apart_s).all()
    assert len(ahead.best) == 3


def test_a_window_is_the_next_day_unless_it_is_said(ctx: Context) -> None:
    make_location(ctx, "door", estimator="static")
    post_states(ctx, "door", [BEGIN, BEGIN + 60.0], [0, 1])
    refit(ctx, "door")
    day = information_at(ctx, "door", InformationQuery(best=1))
    assert (day.time[0], len(day.time), day.time[1] - day.time[0]) == (NOW, 288, 300.0)
    assert information_at(ctx, "door", InformationQuery()).time.tolist() == [NOW]
    assert information_at(ctx, "door", InformationQuery(start=NOW, stop=NOW, best=4)).best.size == 0


def test_work_is_bounded_and_ends_with_the_asker(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    name = make_lab(ctx)
    with pytest.raises(InvalidInputError, match="longer step"):
        information_at(ctx, name, InformationQuery(start=0.0, stop=1e9, step=1.0))
    monkeypatch.setattr("tidemap.services.information.MAX_VALUES", 40)
    with pytest.raises(InvalidInputError, match="4 cells at 11 times are more than 40 values"):
        information_at(ctx, name, InformationQuery(start=0.0, stop=660.0, step=60.0))

    def leave() -> None:
        raise AskerLeftError

    with pytest.raises(AskerLeftError):
        information_at(ctx, name, InformationQuery(start=0.0, stop=600.0, step=60.0), leave)


def test_looks_err_as_the_sensor_does_unless_it_is_said(ctx: Context) -> None:
    make_location(ctx, "door", sensor={"miss": 0.1, "false_alarm": 0.2})
    post_states(ctx, "door", BEGIN + MINUTE * np.arange(200), np.arange(200) % 20 < 10)
    refit(ctx, "door")
    state = Sensor(0.1, 0.2).state_probability(state_at(ctx, "door", StateQuery(NOW, given="model")).probability)
    for miss, rates in ((None, ErrorRates(0.1, 0.2)), (0.0, ErrorRates(0.0, 0.2))):
        view = information_at(ctx, "door", InformationQuery(time=NOW, given="model", miss=miss))
        np.testing.assert_allclose(view.information, information(state, rates), atol=1e-5)


def test_without_readings_it_is_about_the_state_too(ctx: Context) -> None:
    make_location(ctx, "room", sensor={"miss": 0.1, "false_alarm": 0.1})
    post_states(ctx, "room", BEGIN + MINUTE * np.arange(290), np.arange(290) % 10 == 0)
    refit(ctx, "room")
    query = InformationQuery(time=NOW + 30 * 86_400, given="model")
    assert information_at(ctx, "room", query).entropy[0] < 0.05, "a tenth of the readings are false alarms"
