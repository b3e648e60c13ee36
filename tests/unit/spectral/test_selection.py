"""`auto`: what it chooses, from what, and how well that predicts."""

import json

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.spectral import real
from tests.unit.spectral.rivals import KINDS, Tally, histogram, slots
from tests.unit.spectral.test_calendar import BASE, DAY, LONDON, working_hours
from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.auto.selection import Choice, choose
from tidemap.spectral.auto.trials import plan, task
from tidemap.spectral.civil import civil_seconds
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.evaluation import Scores, expected_calibration_error, reliability, score
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.recipe import Prior, Recipe
from tidemap.spectral.window import fit_window

WEEK = 7 * 1440
ORDERS = (1, 2, 3, 4, 5, 6, 8, 10, 15)


def chosen_and_predicted(
    history: History, base: TimeBase, time_zone: str, ahead: NDArray[np.int64]
) -> tuple[Choice, NDArray[np.float32]]:
    """What `auto` makes of a history and what it then expects, (n_cells, n_times)."""
    chosen = choose(history, base, time_zone=time_zone)
    window = (history.start, history.stop)
    if chosen.estimator == "fft":
        window = fit_window(*window, base.interval_s)
    spectrum = fit_recipe(history.window(*window), chosen.recipe, base)
    return chosen, predict_times(spectrum, base.time(ahead))


def test_auto_finds_working_hours_and_says_why() -> None:
    chosen, p = chosen_and_predicted(working_hours(22), BASE, LONDON, np.arange(22 * DAY, 29 * DAY))
    truth = working_hours(29).states()[:, 22 * DAY :]
    assert chosen.estimator == "calendar"
    assert chosen.recipe.time_zone == LONDON
    assert chosen.cells == 3
    assert "averages" in chosen.reason
    assert {row.estimator for row in chosen.table} == {"static", "fft", "calendar"}
    assert score(p[0], truth[0]).log_loss < 0.1


@pytest.mark.parametrize("days", [3, 5, 7, 10])
def test_auto_finds_a_daily_rhythm_in_a_few_days(days: int) -> None:
    history = working_hours(21).window(7 * DAY, (7 + days) * DAY).cells([0, 1])
    chosen, p = chosen_and_predicted(history, BASE, LONDON, np.arange(14 * DAY, 19 * DAY))
    truth = working_hours(21).states()[:2, 14 * DAY : 19 * DAY]
    assert chosen.estimator == "calendar"
    assert score(p, truth).log_loss < (0.35 if days < 7 else 0.25)


def test_auto_keeps_a_period_that_is_no_part_of_a_week() -> None:
    base = TimeBase(real.MONDAY, 600.0)
    time = base.time(np.arange(28 * 144))
    states = (time % (36 * 3600) < 12 * 3600) ^ (np.random.default_rng(1).random(time.size) < 0.05)
    history = History.from_states(states[np.newaxis].astype(np.uint8))
    _, p = chosen_and_predicted(history.window(0, 21 * 144), base, "UTC", np.arange(21 * 144, 28 * 144))
    assert score(p[0], states[21 * 144 :]).error < 0.15


@pytest.mark.parametrize("share", [0.002, 0.3, 0.995])
def test_auto_makes_nothing_of_noise(share: float) -> None:
    states = (np.random.default_rng(4).random((1, 35 * DAY)) < share).astype(np.uint8)
    history = History.from_states(states)
    _, p = chosen_and_predicted(history.window(0, 28 * DAY), BASE, LONDON, np.arange(28 * DAY, 35 * DAY))
    truth = states[:, 28 * DAY :]
    assert score(p, truth).log_loss < 1.05 * score(np.full(p.shape, share), truth).log_loss


def test_auto_follows_a_change_of_regime() -> None:
    states = working_hours(63).states()[:3]
    states[:, 42 * DAY :] = 1 - states[:, 42 * DAY :]
    history = History.from_states(states).window(0, 56 * DAY)
    chosen, p = chosen_and_predicted(history, BASE, LONDON, np.arange(56 * DAY, 63 * DAY))
    assert min(prior.half_life_days for prior in chosen.priors) == 7
    assert score(p, states[:, 56 * DAY :]).log_loss < 0.5


@pytest.mark.parametrize(("weeks", "bound"), [(1, 1.25), (4, 1.1)])
def test_auto_follows_a_timetable(weeks: int, bound: float) -> None:
    """Any quarters of an hour, the same every day: hardly worse than the best histogram of such bins."""
    base, first = TimeBase(real.MONDAY, 900.0), weeks * 672
    random = np.random.default_rng(8)
    due = np.tile(random.random(96) < 0.3, 7 * (weeks + 1))
    states = (due ^ (random.random(due.size) < 0.1)).astype(np.uint8)
    past, ahead = History.from_states(states[np.newaxis, :first]), np.arange(first, states.size)
    _, p = chosen_and_predicted(past, base, "UTC", ahead)
    others = rivals(past, real.Real(past, base, "UTC"), ahead)
    best = min(score(other, states[ahead]).log_loss for _, other in others)
    assert score(p[0], states[ahead]).log_loss < bound * best


def test_what_is_asked_for_is_kept() -> None:
    history = working_hours(20)
    assert choose(history, BASE, orders=(5,), time_zone=LONDON).order in (0, 5)
    one = choose(history, BASE, orders=(7,), time_zone=LONDON, estimator="calendar")
    assert (one.estimator, one.order) == ("calendar", 7)
    assert [(row.estimator, row.order) for row in one.table] == [("calendar", 7)]
    assert choose(history, BASE, time_zone=LONDON, estimator="fft").estimator == "fft"
    assert choose(history, BASE, time_zone=LONDON, estimator="static").recipe.estimator == "static"
    short = choose(history.window(0, DAY), BASE, time_zone=LONDON, estimator="calendar")
    assert (short.estimator, short.order, short.table) == ("calendar", 16, ())
    assert choose(history.window(0, DAY), BASE, orders=(3,), time_zone=LONDON, estimator="fft").order == 3


def test_a_check_ends_a_choice() -> None:
    history = working_hours(16)
    steps: list[int] = []

    def check() -> None:
        steps.append(1)
        if len(steps) == stop:
            raise InterruptedError

    stop = 0
    whole = choose(history, BASE, time_zone=LONDON, check=check)
    assert whole == choose(history, BASE, time_zone=LONDON)
    assert len(steps) > 10
    for stop in (1, len(steps) // 2, len(steps)):
        steps.clear()
        with pytest.raises(InterruptedError):
            choose(history, BASE, time_zone=LONDON, check=check)
        assert len(steps) == stop


def test_auto_repeats_itself_and_its_recipe_is_json() -> None:
    history = working_hours(16)
    one = choose(history, BASE, time_zone=LONDON)
    assert one == choose(history, BASE, time_zone=LONDON)
    assert Recipe.from_dict(json.loads(json.dumps(one.recipe.as_dict()))) == one.recipe
    assert sum(prior.weight for prior in one.priors) == pytest.approx(1)


def test_unobserved_samples_are_never_counted() -> None:
    history = working_hours(20)
    states = history.states()
    states[:, 15 * DAY : 15 * DAY + DAY // 2] = UNOBSERVED
    found = choose(History.from_states(states), BASE, time_zone=LONDON)
    whole = choose(history, BASE, time_zone=LONDON)
    lost = {(a.estimator, a.order): b.n - a.n for a, b in zip(found.table, whole.table, strict=True)}
    assert set(lost.values()) == {3 * 48}


@pytest.mark.parametrize("n_days", [2, 3, 8, 13, 14, 15, 30, 100, 364])
def test_trials_learn_from_other_days_than_they_predict(n_days: int) -> None:
    trials = plan(n_days)
    assert 1 <= len(trials) <= 8
    for trial in trials:
        learned = trial.learned(n_days)
        assert learned.any()
        assert not learned[trial.first : trial.last].any()
        assert trial.around == (n_days < 14)
        assert trial.around or not learned[trial.last :].any()


def test_what_a_trial_learns_and_is_asked() -> None:
    history = working_hours(9)
    made = task(history, BASE, LONDON, 8)
    for i, trial in enumerate(made.trials):
        slot, time = made.times(trial)
        sample = BASE.sample(time)
        past = made.past(trial)
        assert np.all(past.window(int(sample.min()), int(sample.max()) + 1).states() == UNOBSERVED)
        np.testing.assert_array_equal(slot, civil_seconds(time, LONDON) % 604_800 // 900)
        assert made.truth.n_observed[i, 0].sum() == pytest.approx(slot.size)


def test_the_office_door() -> None:
    """The published comparison: seven days learned from, day_1, day_2 and day_3 predicted."""
    states, base = real.office_minutes(), TimeBase(real.MONDAY, 60.0)
    past = History.from_states(states[np.newaxis, :WEEK])
    chosen, p = chosen_and_predicted(past, base, "UTC", np.arange(WEEK, 2 * WEEK))
    assert chosen.estimator == "calendar"
    pooled, days = score(p[0], states[WEEK:]), score(p[0, :2880], states[WEEK : WEEK + 2880])
    assert pooled.brier <= 0.060
    assert pooled.log_loss <= 0.200
    assert pooled.error <= 0.070
    assert days.brier < 0.0824
    assert days.log_loss < 0.264


def test_civil_time_over_the_change_of_clocks_in_a_real_building() -> None:
    signal = real.brains4buildings()
    states = signal.history.states()
    change, stop = 20 * 96, 24 * 96
    past, ahead = signal.history.window(0, change), np.arange(change, stop)
    truth = states[:, ahead]
    loss = {}
    for zone in (signal.time_zone, "UTC"):
        recipe = Recipe("calendar", 16, zone, (Prior(),))
        p = predict_times(fit_recipe(past, recipe, signal.base), signal.base.time(ahead))
        loss[zone] = score(p, truth).log_loss
    assert loss[signal.time_zone] < loss["UTC"]


@pytest.mark.slow
def test_sixteen_weeks_of_nine_rooms() -> None:
    """Refitted weekly from the ninth week on, each next week predicted: below every rival's mean over the rooms."""
    signal = real.aruba()
    found: dict[str, list[Scores]] = {}
    calibration = []
    for room in range(9):
        history = signal.history.cells([room])
        states = history.states()[0]
        parts: dict[str, list[NDArray[np.floating]]] = {}
        ahead = np.arange(8 * WEEK, 16 * WEEK)
        for first in range(8 * WEEK, 16 * WEEK, WEEK):
            past, week = history.window(0, first), np.arange(first, first + WEEK)
            parts.setdefault("auto", []).append(chosen_and_predicted(past, signal.base, "UTC", week)[1][0])
            for name, p in rivals(past, signal, week):
                parts.setdefault(name, []).append(p)
        for name, each in parts.items():
            found.setdefault(name, []).append(score(np.concatenate(each), states[ahead]))
        table = reliability(np.concatenate(parts["auto"]), states[ahead])
        calibration.append(expected_calibration_error(table))
    loss = {name: np.mean([each.log_loss for each in scores]) for name, scores in found.items()}
    brier = {name: np.mean([each.brier for each in scores]) for name, scores in found.items()}
    assert loss["auto"] < min(value for name, value in loss.items() if name != "auto")
    assert brier["auto"] < min(value for name, value in brier.items() if name != "auto")
    assert np.mean(calibration) <= 0.03


def rivals(past: History, signal: real.Real, week: NDArray[np.int64]) -> list[tuple[str, NDArray[np.floating]]]:
    """What `fft` of every order and the histograms expect of a week."""
    base = signal.base
    out: list[tuple[str, NDArray[np.floating]]] = []
    window = past.window(*fit_window(past.start, past.stop, base.interval_s))
    for order in ORDERS:
        p = predict_times(fit_recipe(window, Recipe("fft", order), base), base.time(week))[0]
        out.append((f"fft {order}", p))
    states = past.states()[0]
    known = np.flatnonzero(states != UNOBSERVED)
    tally = Tally.of(civil_seconds(base.time(known), signal.time_zone), states[known])
    ahead = slots(civil_seconds(base.time(week), signal.time_zone))
    for kind in KINDS:
        for bin_s in (900.0, 1800.0, 3600.0):
            for visits in (0.3, 1.0, 3.0):
                p = histogram(tally, ahead, kind, bin_s, visits)
                out.append((f"histogram {kind} {bin_s:g} {visits:g}", p))
    return out
