"""POST /locations/{name}/evaluate: scores of estimators and orders."""

import numpy as np
import pytest

from tests.api.house import DAY, HOUR, NOW, Api, done, fortnight, problem

ANSWERED = {"estimator", "order", "error", "brier", "log_loss", "n"}


@pytest.fixture(scope="module")
def halved(api: Api) -> str:
    """A door whose model knows the first of its two weeks."""
    name = api.location(estimator="fft", order=3)
    api.observe(name, *fortnight())
    api.update(name, stop=NOW - 7 * DAY)
    return name


def test_every_candidate_gets_its_row_and_the_best_is_named(api: Api, halved: str) -> None:
    form = {"start": NOW - 7 * DAY, "stop": NOW, "orders": [0, 1, 2, 5], "estimators": ["fft", "static"]}
    answer = done(api.post(f"/locations/{halved}/evaluate", form))
    assert [(row["estimator"], row["order"]) for row in answer["results"]] == [
        ("fft", 0),
        ("fft", 1),
        ("fft", 2),
        ("fft", 5),
        ("static", 0),
    ]
    assert all(set(row) == ANSWERED and row["n"] == 7 * 24 for row in answer["results"])
    best = min(answer["results"], key=lambda row: row["log_loss"])
    assert answer["best"] == {"estimator": best["estimator"], "order": best["order"]}
    assert (answer["best"]["estimator"], answer["revision"]) == ("fft", 1)
    assert sum(row["n"] for row in answer["reliability"]) == 7 * 24
    assert all(0 <= row["probability"] <= 1 and 0 <= row["observed"] <= 1 for row in answer["reliability"])


def test_the_scores_are_what_they_say(api: Api, halved: str) -> None:
    time, state = (column[-7 * 24 :] for column in fortnight())
    answer = done(api.post(f"/locations/{halved}/evaluate", {"start": time[0], "orders": [2], "estimators": ["fft"]}))
    predicted = done(api.post(f"/locations/{halved}/predict", {"time": time.tolist(), "order": 2}))
    p = np.array(predicted["probability"][0])
    (row,) = answer["results"]
    assert row["error"] == pytest.approx(np.mean((p > 0.5) != state))
    assert row["brier"] == pytest.approx(np.mean((p - state) ** 2), abs=1e-6)


def test_given_measurements_score_as_the_history_does(api: Api, halved: str) -> None:
    time, state = (column[-7 * 24 :] for column in fortnight())
    form = {"orders": [0, 1, 2, 3], "estimators": ["fft"]}
    by_history = done(api.post(f"/locations/{halved}/evaluate", {**form, "start": time[0], "stop": NOW}))
    given = {**form, "time": time.tolist(), "state": state.tolist()}
    assert done(api.post(f"/locations/{halved}/evaluate", given)) == by_history
    before = api.facts(halved)
    done(api.post(f"/locations/{halved}/evaluate", {**given, "start": NOW - DAY, "stop": NOW}))
    assert api.facts(halved) == before


def test_given_measurements_may_lie_in_the_future(api: Api, halved: str) -> None:
    form = {"orders": [3], "time": [NOW + 9.5 * HOUR, "2026-03-03T03:00:00Z"], "state": [1, 0]}
    answer = done(api.post(f"/locations/{halved}/evaluate", form))
    errors = {row["estimator"]: row["error"] for row in answer["results"]}
    assert (errors["fft"], errors["static"]) == (0, 0.5)


def test_the_confidence_moves_the_border(api: Api, halved: str) -> None:
    form = {"orders": [0], "estimators": ["static"], "time": [NOW], "state": [1]}
    for confidence, error in ((None, 1), (0.5, 1), (0.9, 1)):
        how = form if confidence is None else {**form, "confidence": confidence}
        (row,) = done(api.post(f"/locations/{halved}/evaluate", how))["results"]
        assert row["error"] == error


def test_the_training_window_can_be_chosen(api: Api, halved: str) -> None:
    """On its first nine hours the door was never open."""
    begin = NOW - 14 * DAY
    form = {"orders": [0], "estimators": ["static"], "train_start": begin, "train_stop": begin + 9 * HOUR}
    (row,) = done(api.post(f"/locations/{halved}/evaluate", form))["results"]
    assert row["error"] == pytest.approx(8 / 24)


@pytest.mark.parametrize("stop", [6e10, "3800-01-01T00:00:00Z"])
def test_a_training_window_far_beyond_the_history_costs_nothing(api: Api, halved: str, stop: object) -> None:
    form = {"orders": [1], "estimators": ["fft"], "train_start": -6e10, "train_stop": stop}
    (row,) = done(api.post(f"/locations/{halved}/evaluate", form))["results"]
    assert row["n"] == 14 * 24


def test_all_cells_that_were_seen_are_scored_together(api: Api, lab: str) -> None:
    answer = done(api.post(f"/locations/{lab}/evaluate", {"orders": [3], "estimators": ["fft"]}))
    assert answer["results"][0]["n"] == 3 * 14 * 24


def test_measurements_can_be_given_for_a_state_only(api: Api, lab: str) -> None:
    form = {"orders": [3], "time": [NOW], "state": [1]}
    found = problem(api.post(f"/locations/{lab}/evaluate", form), 422)
    assert found["errors"][0]["field"] == "time"


def test_horizons_are_scored_beside_rhythm_and_persistence(api: Api, halved: str) -> None:
    form = {"horizons_s": [HOUR, 4 * HOUR, 9 * DAY], "start": NOW - 7 * DAY, "stop": NOW}
    answer = done(api.post(f"/locations/{halved}/evaluate", form))
    assert (answer["results"], answer["best"], answer["reliability"]) == ([], None, [])
    assert [(row["horizon_s"], row["samples"]) for row in answer["horizons"]] == [
        (HOUR, 1),
        (4 * HOUR, 4),
        (9 * DAY, 216),
    ]
    for row, n in zip(answer["horizons"], (7 * 24, 7 * 24, 5 * 24), strict=True):
        for kind in ("conditioned", "rhythm", "persistence"):
            scores = row[kind]
            assert scores["n"] == sum(each["n"] for each in scores["reliability"]) == n
            assert set(scores) == {"error", "brier", "log_loss", "calibration_error", "n", "reliability"}
            assert 0 <= scores["calibration_error"] <= 1
    both = done(api.post(f"/locations/{halved}/evaluate", {**form, "orders": [2], "estimators": ["fft"]}))
    assert both["horizons"] == answer["horizons"]
    assert both["best"] == {"estimator": "fft", "order": 2}


def test_a_horizon_longer_than_the_history_scores_nothing(api: Api, halved: str) -> None:
    answer = done(api.post(f"/locations/{halved}/evaluate", {"horizons_s": [300 * DAY]}))
    (row,) = answer["horizons"]
    assert row["conditioned"] == {
        "error": None,
        "brier": None,
        "log_loss": None,
        "calibration_error": None,
        "n": 0,
        "reliability": [],
    }
