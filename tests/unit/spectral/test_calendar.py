"""The `calendar` estimator: against the slow truth, and what it promises."""

import json
import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.calendar import folding, logistic, waves
from tidemap.spectral.calendar.folding import Weeks
from tidemap.spectral.calendar.logistic import base_logit, fit_rows
from tidemap.spectral.civil import WEEK_S, civil_seconds
from tidemap.spectral.estimators import ESTIMATORS, fit, fit_recipe
from tidemap.spectral.evaluation import score
from tidemap.spectral.model import reconstruct, refit
from tidemap.spectral.prediction import predict_slow, predict_times
from tidemap.spectral.recipe import PRIORS, Prior, Recipe, Week
from tidemap.spectral.reconstruction import predicted_words
from tidemap.spectral.spectrum import Spectrum, components, truncate

LONDON = "Europe/London"
SPRING = 1_711_324_800.0
"""Monday, 25 March 2024; the clocks of London go forward on the 31st."""
BASE = TimeBase(SPRING - 14 * 86_400, 300.0)
DAY = 288
WHOLE = Recipe("calendar", waves.N_WAVES, LONDON, (Prior(),))


def working_hours(days: int, base: TimeBase = BASE, time_zone: str = LONDON, seed: int = 0) -> History:
    """Three cells occupied from 9 to 17 on weekdays, with different noise, and one that never is."""
    n = round(days * 86_400 / base.interval_s)
    tau_s = civil_seconds(base.time(np.arange(n)), time_zone)
    hour, weekday = tau_s % 86_400 / 3600, tau_s // 86_400 % 7
    full = (hour >= 9) & (hour < 17) & (weekday < 5)
    random = np.random.default_rng(seed)
    rows = [full ^ (random.random(n) < noise) for noise in (0.0, 0.03, 0.2)]
    return History.from_states(np.array([*rows, np.zeros(n, bool)]).astype(np.uint8))


def newton(
    columns: NDArray[np.float64], seen: NDArray[np.float64], full: NDArray[np.float64], prior: Prior, centre: float
) -> NDArray[np.float64]:
    """The maximum of one row's log posterior in float64, by Newton steps that are halved until they help."""
    penalty = waves.penalties(prior).astype(np.float64)
    free = np.isfinite(penalty)
    x, penalty = columns[:, free], penalty[free]
    middle = np.zeros(x.shape[1])
    middle[0] = centre
    beta = middle.copy()

    def objective(at: NDArray[np.float64]) -> float:
        eta = x @ at
        return float(np.sum(full * eta - seen * np.logaddexp(0, eta)) - 0.5 * np.sum(penalty * (at - middle) ** 2))

    for _ in range(50):
        p = 1 / (1 + np.exp(-x @ beta))
        gradient = x.T @ (full - seen * p) - penalty * (beta - middle)
        step = np.linalg.solve((x.T * (seen * p * (1 - p))) @ x + np.diag(penalty), gradient)
        while objective(beta + step) < objective(beta) - 1e-12:
            step /= 2
        beta = beta + step
        if float(gradient @ step) < 1e-10:
            break
    out = np.zeros(columns.shape[1])
    out[free] = beta
    return out


def folded(history: History, base: TimeBase, prior: Prior, time_zone: str = LONDON) -> Weeks:
    seen = folding.visits(history, base, time_zone)
    every = np.ones((1, seen.n_days), np.float32)
    weeks = folding.fold(history, np.arange(history.n_cells), seen, every, [prior.half_life_days])
    return Weeks(weeks.n_observed[0], weeks.n_occupied[0])


@pytest.mark.parametrize("prior", [Prior(), Prior(week="days", detail="sharp", evidence=1.0), Prior(evidence=0.05)])
def test_the_ascent_finds_the_maximum(prior: Prior) -> None:
    weeks = folded(working_hours(20), BASE, prior)
    design = waves.design(folding.slot_offset_s(BASE))
    evidence = np.full(4, prior.evidence, np.float32)
    found = fit_rows(design, weeks.n_observed, weeks.n_occupied, evidence, waves.penalties(prior))
    for row in range(3):
        seen, full = (prior.evidence * each[row].astype(np.float64) for each in (weeks.n_observed, weeks.n_occupied))
        centre = float(base_logit(weeks.n_observed[row : row + 1], weeks.n_occupied[row : row + 1])[0])
        best = newton(design.astype(np.float64), seen, full, prior, centre)
        p, truth = (1 / (1 + np.exp(-(design @ beta))) for beta in (found[row], best))
        assert np.abs(p - truth).max() < 0.02
        assert np.abs(p - truth).mean() < 0.002


@pytest.mark.parametrize("interval_s", [60.0, 300.0, 900.0])
def test_folding_costs_less_than_a_hundredth_of_probability(interval_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the fit of every sample at its own time, with the same weights."""
    monkeypatch.setattr(logistic, "TOLERANCE", 1e-5)
    monkeypatch.setattr(logistic, "STEPS", 300)
    base, prior = TimeBase(BASE.epoch, interval_s), Prior(half_life_days=10.0)
    history = working_hours(9, base)
    tau_s = civil_seconds(base.time(np.arange(history.n_samples)), LONDON)
    day = (tau_s // 86_400).astype(int) - int(tau_s[0] // 86_400)
    weight = folding.recency(int(day[-1]) + 1, prior.half_life_days)[day].astype(np.float64)
    weight *= prior.evidence * min(1.0, interval_s / 900)
    weeks, states = folded(history, base, prior), history.states()
    spectrum = fit_recipe(history, replace(WHOLE, priors=(prior,)), base)
    for cell in range(3):
        centre = float(base_logit(weeks.n_observed[cell : cell + 1], weeks.n_occupied[cell : cell + 1])[0])
        best = newton(waves.columns(tau_s), weight, weight * states[cell], prior, centre)
        truth = 1 / (1 + np.exp(-(waves.columns(tau_s) @ best)))
        p = predict_times(spectrum, base.time(np.arange(history.n_samples)), [cell])[0]
        assert np.abs(p - truth).max() < 0.01
        assert np.abs(p - truth).mean() < 0.001


@pytest.mark.parametrize("interval_s", [7.0, 60.0, 300.0, 1000.0, 3600.0])
def test_folding_counts_what_was_observed(interval_s: float) -> None:
    base = TimeBase(SPRING + 1234.5, interval_s)
    states = np.random.default_rng(3).integers(0, 3, (5, int(9.3 * 86_400 / interval_s))).astype(np.uint8)
    states[:, 40:200], states[4] = 2, 2
    history = History.from_states(states, start=-77)
    seen = folding.visits(history, base, LONDON)
    weight = np.stack([folding.recency(seen.n_days, 3.0), np.arange(seen.n_days) % 2]).astype(np.float32)
    weeks = folding.fold(history, np.arange(5), seen, weight)
    tau_s = civil_seconds(base.middle(np.arange(history.start, history.stop)), LONDON)
    slot, day = (tau_s % WEEK_S // 900).astype(int), (tau_s // 86_400).astype(int)
    visit = np.cumsum(np.diff(tau_s // 900, prepend=-1) != 0)
    for cell in range(5):
        known = states[cell] != 2
        scale = len(set(visit[known])) / max(1, known.sum())
        for row in range(2):
            each = np.where(known, weight[row, np.searchsorted(seen.date, day).clip(max=seen.n_days - 1)], 0) * scale
            np.testing.assert_allclose(
                weeks.n_observed[row, cell], np.bincount(slot, each * known, 672), rtol=2e-5, atol=1e-5
            )
            full = np.bincount(slot, each * (states[cell] == 1), 672)
            np.testing.assert_allclose(weeks.n_occupied[row, cell], full, rtol=2e-5, atol=1e-5)


@pytest.mark.parametrize("interval_s", [7.0, 300.0, 3600.0])
def test_days_on_which_a_cell_was_seen_are_counted(interval_s: float) -> None:
    base = TimeBase(SPRING + 1234.5, interval_s)
    random = np.random.default_rng(6)
    states = random.integers(0, 2, (5, int(9.3 * 86_400 / interval_s))).astype(np.uint8)
    states[random.random(states.shape) < 0.3] = 2
    states[1, : states.shape[1] // 2], states[2, 1:], states[3, :-1], states[4] = 2, 2, 2, 2
    states[2, 0] = states[3, -1] = 1
    history = History.from_states(states, start=-77)
    seen = folding.visits(history, base, LONDON)
    day = civil_seconds(base.time(np.arange(history.start, history.stop)), LONDON) // 86_400
    expected = [np.unique(day[row != 2]).size for row in states]
    np.testing.assert_array_equal(folding.days_seen(history, np.arange(5), seen), expected)
    np.testing.assert_array_equal(folding.days_seen(history, np.array([3, 1]), seen), [expected[3], expected[1]])


@pytest.mark.parametrize("interval_s", [7.0, 300.0, 3600.0])
@pytest.mark.parametrize("share", [0.002, 0.3, 0.95])
def test_visits_in_which_a_cell_was_seen_are_counted(interval_s: float, share: float) -> None:
    base, random = TimeBase(SPRING + 1234.5, interval_s), np.random.default_rng(7)
    states = np.where(random.random((4, int(9.3 * 86_400 / interval_s))) < share, 1, 2).astype(np.uint8)
    states[0, -3:], states[1, :2], states[2] = 1, 1, 2
    history = History.from_states(states, start=-77)
    slot = civil_seconds(base.middle(np.arange(history.start, history.stop)), LONDON) // 900
    expected = [np.unique(slot[row != 2]).size for row in states]
    seen = folding.visits(history, base, LONDON)
    np.testing.assert_array_equal(folding.visits_seen(history, np.arange(4), seen), expected)
    np.testing.assert_array_equal(folding.visits_seen(history, np.array([3, 1]), seen), [expected[3], expected[1]])


def test_a_daily_rhythm_stays_on_the_clock_over_the_change_to_summer_time() -> None:
    history = working_hours(28)
    past = history.window(0, 20 * DAY)
    after = np.arange(20 * DAY, 27 * DAY)
    loss = {
        zone: score(
            predict_times(fit_recipe(past, replace(WHOLE, time_zone=zone), BASE), BASE.time(after))[1],
            history.states()[1, after],
        ).log_loss
        for zone in (LONDON, "UTC")
    }
    assert loss[LONDON] < 0.8 * loss["UTC"]


@pytest.mark.parametrize("hours", [0, 1, 5, 11, 17, 23])
def test_windows_that_are_not_whole_days_keep_the_rhythm(hours: int) -> None:
    history = working_hours(26)
    start, stop = 2 * DAY + 5 * hours, 18 * DAY + 12 * hours
    spectrum = fit_recipe(history.window(start, stop), WHOLE, BASE)
    ahead = np.arange(stop, stop + 7 * DAY)
    assert score(predict_times(spectrum, BASE.time(ahead))[0], history.states()[0, ahead]).log_loss < 0.16


@pytest.mark.parametrize("name", sorted(ESTIMATORS))
def test_every_estimator_handles_every_cell(name: str) -> None:
    states = np.full((6, 3 * DAY), 2, np.uint8)
    states[0], states[1], states[2, 7], states[3, 9], states[4, 100:102] = 0, 1, 0, 1, (0, 1)
    model = refit(History.from_states(states, 11), Recipe(name, 5, LONDON), BASE)
    np.testing.assert_array_equal(reconstruct(model), states)
    p = predict_times(model.spectrum, BASE.time(np.arange(-500, 3000, 97)))
    assert np.all(p[0] < 0.01)
    assert np.all(p[1] > 0.99)
    assert np.all(p[2] < 0.5)
    assert np.all(p[3] > 0.5)
    assert np.all((p[4] >= 0) & (p[4] <= 1))
    assert np.all(np.isnan(p[5]))


def test_the_order_of_arrival_and_a_second_fit_change_nothing() -> None:
    history = working_hours(15)
    early, late = history.window(0, 6 * DAY + 17), history.window(6 * DAY + 17, history.stop)
    recipe = Recipe("calendar", 16, LONDON)
    one = fit_recipe(early.overlay(late), recipe, BASE)
    for other in (late.overlay(early), history):
        same(fit_recipe(other, recipe, BASE), one)


def test_whole_weeks_change_nothing() -> None:
    history = working_hours(16)
    week = 7 * DAY
    later = History(history.start + 9 * week, history.n_samples, history.observed, history.occupied)
    same(*(fit_recipe(each, Recipe("calendar", 16), BASE) for each in (history, later)))


def test_samples_before_the_latest_year_are_not_read() -> None:
    base = TimeBase(SPRING, 3600.0)
    states = np.random.default_rng(2).integers(0, 2, (2, 400 * 24)).astype(np.uint8)
    other = states.copy()
    other[:, : 30 * 24] = 1 - other[:, : 30 * 24]
    same(*(fit_recipe(History.from_states(each), Recipe("calendar", 8), base) for each in (states, other)))


def test_orders_are_honoured() -> None:
    history = working_hours(15)
    ahead = BASE.time(np.arange(15 * DAY, 22 * DAY))
    loss = {}
    for order in (0, 1, 2, 4, 8, 16, 64):
        spectrum = fit_recipe(history, replace(WHOLE, order=order), BASE)
        assert spectrum.order <= order
        assert components(spectrum, 1).amplitude.size <= order
        loss[order] = score(predict_times(spectrum, ahead)[:3], working_hours(22).states()[:3, -7 * DAY :]).log_loss
    assert loss[0] > loss[1] > loss[2] > 1.15 * loss[8]
    cut = truncate(fit_recipe(history, replace(WHOLE, order=64), BASE), 2)
    short = score(predict_times(cut, ahead)[:3], working_hours(22).states()[:3, -7 * DAY :]).log_loss
    assert loss[2] <= short, "fitted at an order is no worse than cut to it"


def test_recent_days_count_more_with_a_half_life() -> None:
    states = working_hours(56).states()
    states[:, 42 * DAY :] = 1 - states[:, 42 * DAY :]
    history = History.from_states(states)
    ahead = BASE.time(np.arange(56 * DAY, 63 * DAY))
    truth = 1 - working_hours(63).states()[:3, -7 * DAY :]
    loss = [
        score(
            predict_times(fit_recipe(history, replace(WHOLE, priors=(Prior(half_life_days=life),)), BASE), ahead)[:3],
            truth,
        )
        for life in (4.0, math.inf)
    ]
    assert loss[0].log_loss < 0.4 < loss[1].log_loss


def test_a_spectrum_of_calendar_has_its_words_by_the_week() -> None:
    history = working_hours(20)
    for recipe in (WHOLE, replace(WHOLE, order=5), replace(WHOLE, order=16, priors=(Prior(week="day"),))):
        spectrum = fit_recipe(history, recipe, BASE)
        start, stop = -130, 40 * DAY
        words = predicted_words(spectrum, BASE, start, stop)
        first = 64 * (start // 64)
        bits = np.unpackbits(words.view(np.uint8), axis=1, bitorder="little")
        truth = predict_slow(spectrum, BASE.time(first + np.arange(bits.shape[1])))
        clear = np.abs(truth - 0.5) > 2e-5
        np.testing.assert_array_equal(bits[clear], (truth > 0.5)[clear])
        part = predicted_words(spectrum, BASE, 13 * DAY + 5, 20 * DAY)
        at = (13 * DAY + 5) // 64 - first // 64
        np.testing.assert_array_equal(part, words[:, at : at + part.shape[1]])


def test_recipes_come_back_from_json() -> None:
    recipe = Recipe("calendar", 12, LONDON, (*PRIORS, Prior(half_life_days=math.inf)), 129_600.0, 0.75, 0.4)
    again = Recipe.from_dict(json.loads(json.dumps(recipe.as_dict())))
    assert (again, hash(again)) == (recipe, hash(recipe))
    older = {name: value for name, value in Recipe("calendar").as_dict().items() if name not in ("follow", "doubt")}
    assert Recipe.from_dict(older) == Recipe("calendar"), "as stored before levels were followed"
    wrong_priors = partial(Prior, evidence=0.0), partial(Prior, half_life_days=-1.0), partial(Prior, weight=math.inf)
    for make in wrong_priors:
        with pytest.raises(ValueError, match="positive"):
            make()
    with pytest.raises(ValueError, match="negative"):
        Recipe("calendar", -1)
    with pytest.raises(ValueError, match="prior"):
        Recipe("calendar", 1, priors=())
    with pytest.raises(ValueError, match="unknown estimator"):
        fit(working_hours(1), "prophet", 3, BASE)


def test_priors_differ_in_what_they_let_differ() -> None:
    differing: dict[Week, set[int]] = {"day": {0}, "weekend": {0, 1}, "week": {0, 1, 2}, "days": {0, 1, 2}}
    for week, kinds in differing.items():
        variance = waves.variances(Prior(week=week))
        assert set(waves.KIND[variance > 0]) == kinds
        assert variance[waves.KIND == 0].sum() == pytest.approx(waves.SCALE**2)


def same(one: Spectrum, other: Spectrum) -> None:
    for name in ("mean", "cell", "index", "coefficient", "frequency_hz", "gate"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
