"""One meaning of p(t): the expectation for the sample that contains t, wherever it is asked and whatever the clock."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.support.records import location_record
from tidemap.history.history import History
from tidemap.history.measurements import Measurements
from tidemap.history.timebase import TimeBase
from tidemap.services.context import Loaded
from tidemap.services.judge import judge
from tidemap.services.spectra import Fitted
from tidemap.space.grid import GridGeometry
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.estimators import ESTIMATORS, fit_recipe
from tidemap.spectral.prediction import predict, predict_times
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.spectrum import Spectrum
from tidemap.spectral.window import fft_window
from tidemap.storage.records import LocationRecord, RevisionRecord

WEEK_S = 604_800.0
MONDAY = datetime(2023, 5, 1, tzinfo=UTC).timestamp()
ZONES = st.sampled_from(["UTC", "Europe/London", "Asia/Kathmandu"])
BASES = st.builds(
    TimeBase,
    st.sampled_from([0.0, MONDAY, MONDAY + 0.3, -1234.5]),
    st.sampled_from([0.1, 1.0, 7.0, 60.0, 300.7, 600.0, 3600.0, 86_400.0]),
)
STATES = hnp.arrays(
    np.uint8, st.tuples(st.integers(1, 3), st.integers(1, 400)), elements=st.integers(0, 2), fill=st.integers(0, 2)
)
RECIPES = st.builds(Recipe, st.sampled_from(sorted(ESTIMATORS)), st.integers(0, 20), ZONES)
WITHIN = st.floats(0.001, 0.999)
"""Where in its sample a time lies; at its very border rounding decides."""
REVISION = RevisionRecord(1, 1, Recipe("static", 0), 0, 1, 0, 0, None, 0.0, None)
quick = settings(max_examples=80, deadline=None)


def location_of(base: TimeBase, n_cells: int, confidence: float) -> LocationRecord:
    grid = GridGeometry("map", (0.0, 0.0, 0.0), 1.0, (n_cells, 2)) if n_cells > 1 else None
    kind = "grid2d" if grid else "state"
    return location_record(kind=kind, grid=grid, interval_s=base.interval_s, epoch=base.epoch, confidence=confidence)


def judged(spectrum: Spectrum, base: TimeBase, times: list[float], cell: int) -> list[float]:
    """The p by which readings of a cell at some times are judged: each contradicts what is expected."""
    state = (predict_times(spectrum, times, [cell])[0] < 0.5).astype(np.uint8)
    cells = np.full(len(times), cell, np.uint32)
    readings = Measurements(np.array(times, np.float64), cells, state).in_order()
    location = location_of(base, spectrum.n_cells // 2, 0.49)
    return [event.probability for event in judge(Fitted(location, Loaded(REVISION, spectrum, {})), readings)]


@quick
@given(STATES, BASES, RECIPES, st.integers(-3000, 3000), st.integers(-500, 900), WITHIN, st.data())
def test_what_is_predicted_for_a_time_is_what_a_reading_then_is_judged_by(
    states: np.ndarray, base: TimeBase, recipe: Recipe, start: int, ahead: int, within: float, data: st.DataObject
) -> None:
    history = History.from_states(np.repeat(states, 2, axis=0), start)
    spectrum = fit_recipe(history, recipe, base)
    known = np.flatnonzero(history.ever_observed())
    if not known.size:
        return
    cell = int(data.draw(st.sampled_from(known.tolist())))
    time = float(base.time(start + ahead + within))
    other = float(base.time(start + ahead + 40 + within))
    p, later = (float(predict(spectrum, each)[cell]) for each in (time, other))
    np.testing.assert_allclose(predict_times(spectrum, [time, other], [cell])[0], [p, later], atol=1e-6)
    np.testing.assert_allclose(judged(spectrum, base, [time], cell), [p], atol=1e-6)
    np.testing.assert_allclose(sorted(judged(spectrum, base, [time, other], cell)), sorted([p, later]), atol=1e-6)


@quick
@given(STATES, BASES, RECIPES, st.integers(-3000, 3000), st.integers(-500, 900), st.lists(WITHIN, min_size=1))
def test_p_is_the_same_all_over_a_sample(
    states: np.ndarray, base: TimeBase, recipe: Recipe, start: int, ahead: int, within: list[float]
) -> None:
    spectrum = fit_recipe(History.from_states(states, start), recipe, base)
    p = predict_times(spectrum, base.time(start + ahead + np.array([0.0, *within])))
    np.testing.assert_array_equal(p, np.repeat(p[:, :1], p.shape[1], axis=1))


@quick
@given(
    STATES,
    BASES,
    st.sampled_from(["fft", "static"]),
    st.integers(0, 12),
    st.integers(-(10**5), 10**5),
    st.lists(st.tuples(st.integers(-500, 900), WITHIN), min_size=1),
)
def test_a_clock_that_is_off_by_whole_samples_shifts_answers_and_nothing_else(
    states: np.ndarray, base: TimeBase, name: str, order: int, shift: int, asked: list[tuple[int, float]]
) -> None:
    """Whether the samples or the epoch are shifted."""
    recipe = Recipe(name, order)
    at = np.array([sample + within for sample, within in asked])
    other_epoch = replace(base, epoch=float(base.time(shift)))
    expected = predict_times(fit_recipe(History.from_states(states), recipe, base), base.time(at))
    for start, scale in ((shift, base), (0, other_epoch)):
        spectrum = fit_recipe(History.from_states(states, start), recipe, scale)
        p = predict_times(spectrum, scale.time(start + at))
        np.testing.assert_allclose(p, expected, atol=5e-5)
    part = fft_window(np.flatnonzero((states != 2).any(axis=0)), 0, states.shape[1], base.interval_s)
    seen = shift + np.flatnonzero((states != 2).any(axis=0))
    assert fft_window(seen, shift, shift + states.shape[1], base.interval_s) == (shift + part[0], shift + part[1])


@quick
@given(
    STATES,
    st.sampled_from([300.0, 3600.0]),
    st.integers(0, 30),
    st.integers(-60, 60),
    st.lists(st.tuples(st.integers(-500, 900), WITHIN), min_size=1),
)
def test_a_clock_that_is_off_by_whole_weeks_shifts_what_calendar_says(
    states: np.ndarray, interval_s: float, order: int, weeks: int, asked: list[tuple[int, float]]
) -> None:
    base, recipe = TimeBase(MONDAY, interval_s), Recipe("calendar", order, "UTC", carry_over=0.5, level_sd=0.4)
    shift = weeks * int(WEEK_S / interval_s)
    at = np.array([sample + within for sample, within in asked])
    one, other = (fit_recipe(History.from_states(states, start), recipe, base) for start in (0, shift))
    np.testing.assert_array_equal(one.mean, other.mean)
    np.testing.assert_array_equal(one.coefficient, other.coefficient)
    p, later = predict_times(one, base.time(at)), predict_times(other, base.time(at + shift))
    np.testing.assert_allclose(p, later, atol=1e-6)


@settings(max_examples=6, deadline=None)
@given(st.integers(-60, 60), st.integers(1, 3), st.integers(0, 2**16))
def test_and_leaves_the_choice_of_auto_as_it_is(weeks: int, every: int, seed: int) -> None:
    base, random = TimeBase(MONDAY, 3600.0), np.random.default_rng(seed)
    hour = np.arange(17 * 24)
    states = (((hour % 24 > 8) & (hour % 24 < 18)) ^ (random.random(hour.size) < 0.1)).astype(np.uint8)[np.newaxis]
    states[:, hour % every != 0] = 2
    one, other = (choose(History.from_states(states, start), base, time_zone="UTC") for start in (0, 168 * weeks))
    assert one.recipe == other.recipe
    assert [row.n for row in one.table] == [row.n for row in other.table]
