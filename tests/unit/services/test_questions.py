"""Questions: what was predicted and what was observed, and never anything that is out of date."""

from typing import Any

import numpy as np
import pytest

from tests.support.contexts import compact_now, make_location, post_rows, post_states, refit
from tests.support.truth import share
from tidemap.errors import CellNotFoundError, InvalidInputError, LocationNotFoundError, NoModelError
from tidemap.services.context import Context
from tidemap.services.locations import LocationChanges, change_location
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.services.series import SeriesQuery, series
from tidemap.services.spectra import fitted
from tidemap.services.state import StateQuery, state_at
from tidemap.spectral.prediction import predict_slow

DAY = 86_400.0
NEVER = 2


def rhythmic_lab(ctx: Context) -> None:
    """A grid of two chunks; a few cells are occupied in the first half of every twenty minutes, one always."""
    make_location(ctx, "lab", (40, 40), confidence=0.8)
    rows = [(60.0 * n, cell, int(n % 20 < 10)) for n in range(200) for cell in (3, 700, 1030)]
    post_rows(ctx, "lab", rows + [(60.0 * n, 1599, 1) for n in range(200)])
    refit(ctx, "lab", estimator="fft", order=2)


def test_a_state_is_the_probability_and_what_follows_from_it(ctx: Context) -> None:
    rhythmic_lab(ctx)
    view = state_at(ctx, "lab", StateQuery(60.0 * 1003))
    assert view.cell.tolist() == [3, 700, 1030, 1599]
    assert (view.confidence, view.estimator, view.order, view.revision) == (0.8, "fft", 2, 1)
    assert (view.shape, view.n_cells) == ((40, 40), 1600)
    spectrum = fitted(ctx, "lab").spectrum
    np.testing.assert_allclose(view.probability, predict_slow(spectrum, 60.0 * 1003, view.cell)[:, 0], atol=1e-5)
    assert view.probability.tolist()[3] == pytest.approx(share(200, 200))
    assert view.state.tolist() == (view.probability > 0.8).astype(int).tolist()
    assert (view.observed, view.observed_time) == (None, None)
    free = state_at(ctx, "lab", StateQuery(60.0 * 1013, confidence=0.6))
    assert free.verdict.tolist() == [0, 0, 0, 1]
    assert state_at(ctx, "lab", StateQuery(60.0 * 1003, order=0)).probability.tolist() == pytest.approx(
        [0.5, 0.5, 0.5, share(200, 200)]
    )
    assert state_at(ctx, "lab", StateQuery(60.0 * 1003, estimator="static")).order == 0


def test_a_box_keeps_the_cells_whose_centre_it_holds(ctx: Context) -> None:
    rhythmic_lab(ctx)
    view = state_at(ctx, "lab", StateQuery(0.0, bbox=(0.0, 0.0, 0.0, 9.0, 11.0, 1.0), observed=True))
    assert view.cell.tolist() == [3, 700]
    assert view.observed is not None
    assert view.observed.tolist() == [1, 1]
    assert state_at(ctx, "lab", StateQuery(0.0, bbox=(90.0, 0.0, 0.0, 99.0, 1.0, 1.0), observed=True)).cell.size == 0


@pytest.mark.parametrize("compacted", [False, True])
def test_observed_is_what_was_last_seen_then_and_never_later(ctx: Context, compacted: bool) -> None:
    make_location(ctx, "lab", (40, 40))
    # Cell 0 changes twice, over several segments; cell 1 is seen once, cell 1500 late.
    changes = [(0.0, 0, 1), (60.0, 1, 0), (60.0 * 5000, 0, 0), (60.0 * 9000, 0, 1), (60.0 * 9000, 1500, 1)]
    post_rows(ctx, "lab", changes)
    refit(ctx, "lab", estimator="static", start=0.0, stop=60.0 * 9001)
    if compacted:
        compact_now(ctx, "lab")

    def seen(time: float) -> list[tuple[int, float | None]]:
        view = state_at(ctx, "lab", StateQuery(time, observed=True))
        assert view.cell.tolist() == [0, 1, 1500]
        assert view.observed is not None
        assert view.observed_time is not None
        times = [None if np.isnan(at) else at for at in view.observed_time.tolist()]
        return list(zip(view.observed.tolist(), times, strict=True))

    never = (NEVER, None)
    assert seen(-1.0) == [never, never, never]
    assert seen(0.0) == [(1, 0.0), never, never]
    assert seen(59.9) == [(1, 0.0), never, never]
    assert seen(60.0) == [(1, 0.0), (0, 60.0), never]
    assert seen(60.0 * 5000 - 0.1) == [(1, 0.0), (0, 60.0), never]
    assert seen(60.0 * 5000) == [(0, 60.0 * 5000), (0, 60.0), never]
    late = [(1, 60.0 * 9000), (0, 60.0), (1, 60.0 * 9000)]
    assert seen(60.0 * 9000) == late
    assert seen(60.0 * 9e6) == late
    # An earlier measurement that arrives late.
    post_rows(ctx, "lab", [(60.0 * 7000, 1, 1)])
    assert seen(60.0 * 6999)[1] == (0, 60.0)
    assert seen(60.0 * 7000)[1] == (1, 60.0 * 7000)


def test_a_prediction_is_the_direct_sum_for_every_cell_and_time(ctx: Context) -> None:
    rhythmic_lab(ctx)
    times = [0.0, -DAY, 61.5, 9 * DAY]
    view = predict_at(ctx, "lab", PredictQuery(times, [1030, 0, 3, 3]))
    expected = predict_slow(fitted(ctx, "lab").spectrum, times, [1030, 0, 3, 3])
    np.testing.assert_allclose(view.probability, expected, atol=1e-5)
    assert np.isnan(view.probability[1]).all()
    assert view.state[1].tolist() == [NEVER] * 4
    assert np.isnan(view.entropy[1]).all()
    np.testing.assert_array_equal(view.probability[2], view.probability[3])
    assert predict_at(ctx, "lab", PredictQuery([0.0])).cell.tolist() == list(range(1600))
    assert ((view.entropy[0] >= 0) & (view.entropy[0] <= 1)).all()


def test_a_series_is_prediction_and_observation_side_by_side(ctx: Context) -> None:
    make_location(ctx, "door", estimator="static")
    post_states(ctx, "door", [0.0, 60.0, 200.0], [1, 1, 0])
    view = series(ctx, "door")
    assert view.time.tolist() == [0.0, 60.0, 120.0, 180.0]
    assert view.observed.tolist() == [1, 1, NEVER, 0]
    assert np.isnan(view.probability).all()
    assert (view.revision, view.state.tolist()) == (0, [NEVER] * 4)
    refit(ctx, "door")
    view = series(ctx, "door", SeriesQuery(start=-90.0, stop=300.0, step=90.0))
    assert view.time.tolist() == [-90.0, 0.0, 90.0, 180.0, 270.0]
    assert view.observed.tolist() == [NEVER, 1, 1, 0, NEVER]
    np.testing.assert_allclose(view.probability, share(2, 3))
    assert view.revision == 1


def test_a_held_state_stands_until_the_next_measurement_or_its_time_is_over(ctx: Context) -> None:
    make_location(ctx, "door", estimator="static", missing="hold", hold_s=180.0)
    post_states(ctx, "door", [0.0, 60.0 * 5, 60.0 * 7, 60.0 * 20], [1, 1, 0, 1])
    observed = series(ctx, "door").observed.tolist()
    assert observed == [1, 1, 1, 1, 2, 1, 1, 0, 0, 0, 0, *[2] * 9, *[1] * 4]
    part = series(ctx, "door", SeriesQuery(start=60.0 * 2, stop=60.0 * 6))
    assert part.observed.tolist() == [1, 1, 2, 1]
    assert refit(ctx, "door").accuracy == 1 - 4 / 14
    # What was last seen is a measurement, not how long it is taken to stand.
    view = state_at(ctx, "door", StateQuery(60.0 * 19, observed=True))
    assert view.observed_time is not None
    assert view.observed_time.tolist() == [60.0 * 7]
    change_location(ctx, "door", LocationChanges(missing="mask"))
    assert series(ctx, "door").observed.tolist() == [1, 2, 2, 2, 2, 1, 2, 0, *[2] * 12, 1]


@pytest.mark.parametrize(
    "question",
    [lambda ctx: state_at(ctx, "door", StateQuery(0.0)), lambda ctx: predict_at(ctx, "door", PredictQuery([0.0]))],
)
def test_without_a_model_there_is_no_prediction(ctx: Context, question: Any) -> None:
    with pytest.raises(LocationNotFoundError):
        question(ctx)
    make_location(ctx, "door")
    with pytest.raises(NoModelError, match="post observations, then POST /locations/door/update"):
        question(ctx)


def test_impossible_questions_are_refused_by_name(ctx: Context) -> None:
    rhythmic_lab(ctx)
    make_location(ctx, "door", estimator="static")
    post_states(ctx, "door", [0.0], [1])
    refit(ctx, "door")
    for ask, error, word in (
        (lambda: state_at(ctx, "door", StateQuery(0.0, bbox=(0.0,) * 6)), InvalidInputError, "bbox"),
        (lambda: predict_at(ctx, "lab", PredictQuery([0.0], [1600])), CellNotFoundError, "cells are 0 to 1599"),
        (lambda: predict_at(ctx, "lab", PredictQuery([0.0], [-1])), CellNotFoundError, "Cell -1"),
        (lambda: predict_at(ctx, "lab", PredictQuery([0.0] * 1000)), InvalidInputError, "1600000 values"),
        (lambda: series(ctx, "lab", SeriesQuery(1600)), CellNotFoundError, "Cell 1600"),
        (lambda: series(ctx, "lab", SeriesQuery(0, 10.0, 0.0)), InvalidInputError, "before start"),
        (lambda: series(ctx, "lab", SeriesQuery(0, 0.0, 1e9, 1.0)), InvalidInputError, "step"),
        (lambda: series(ctx, "lab", SeriesQuery(0, 0.0, 1.0, 0.0)), InvalidInputError, "step"),
    ):
        with pytest.raises(error, match=word):
            ask()


def test_no_answer_is_out_of_date(ctx: Context) -> None:
    """Everything is asked twice, so that caches are filled, and again after each change."""
    make_location(ctx, "door", estimator="static")

    def answers() -> tuple[Any, ...]:
        for _ in range(2):
            view = state_at(ctx, "door", StateQuery(240.0, observed=True))
            observed = series(ctx, "door", SeriesQuery(start=0.0, stop=300.0)).observed.tolist()
        assert view.observed is not None
        return view.revision, view.probability.tolist(), view.observed.tolist(), observed

    post_states(ctx, "door", [0.0], [1])
    refit(ctx, "door")
    assert answers() == (1, [0.75], [1], [1, 2, 2, 2, 2])
    post_states(ctx, "door", [180.0], [0])
    assert answers() == (1, [0.75], [0], [1, 2, 2, 0, 2])
    refit(ctx, "door")
    assert answers() == (2, [0.5], [0], [1, 2, 2, 0, 2])
    post_states(ctx, "door", [190.0], [1])
    assert answers() == (2, [0.5], [1], [1, 2, 2, 1, 2])
    compact_now(ctx, "door")
    assert answers() == (2, [0.5], [1], [1, 2, 2, 1, 2])
    refit(ctx, "door", start=0.0, stop=60.0)
    assert answers() == (3, [0.75], [1], [1, 2, 2, 1, 2])


def test_another_order_or_estimator_follows_the_update_too(ctx: Context) -> None:
    make_location(ctx, "door", estimator="fft")
    for revision, state in ((1, 1), (2, 0)):
        post_states(ctx, "door", np.arange(100) * 60.0 + revision, np.full(100, state))
        refit(ctx, "door", order=1)
        for estimator, order in (("static", None), ("fft", 3), ("fft", 0), (None, None)):
            view = state_at(ctx, "door", StateQuery(0.0, estimator=estimator, order=order))
            assert (view.revision, view.probability.tolist()) == (revision, pytest.approx([share(100 * state, 100)]))


def test_one_early_measurement_does_not_fill_the_memory(ctx: Context) -> None:
    """A robot whose clock says 1970: the window that is modelled stays one that can be held."""
    make_location(ctx, "lab", (40, 40), estimator="static")
    post_rows(ctx, "lab", [(0.0, 7, 1)])
    recent = 1.69e9
    post_rows(ctx, "lab", [(recent + 60.0 * n, 7, 0) for n in range(10)])
    record = refit(ctx, "lab")
    assert record.stop - record.start <= 2**27 // 1024
    view = state_at(ctx, "lab", StateQuery(recent + 600.0, observed=True))
    assert view.observed is not None
    assert (view.probability.tolist(), view.observed.tolist()) == (pytest.approx([share(0, 10)]), [0])
    assert max(history.observed.nbytes for history in _held(ctx)) < 20e6


def _held(ctx: Context) -> list[Any]:
    return [entry.value for entry in ctx.caches.histories._entries.values()]
