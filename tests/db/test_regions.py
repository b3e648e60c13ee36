"""Locations too large to be held as a whole: the same answers from the parts that a question is about, and no more."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.contexts import NOW, compact_now, history_of, make_location, opened, post_rows, refit
from tidemap.errors import InvalidInputError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.services import spectra
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.detect import DetectQuery, detect
from tidemap.services.evaluate import EvaluateQuery, evaluate
from tidemap.services.export import ExportQuery, export_map
from tidemap.services.information import InformationQuery, information_at
from tidemap.services.map_view import MapQuery, map_at
from tidemap.services.model import model_of
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.services.series import SeriesQuery, series
from tidemap.services.state import StateQuery, StateView, ask, buffer_of, grid_of, state_at
from tidemap.services.verify import Finding, verify
from tidemap.spectral.spectrum import Spectrum, concatenate

HOUR = 3600.0
SHAPE = (40, 32, 32)
"""Forty chunks of one layer each."""
LAYERS = (3, 4, 30)
"""Those that were ever seen."""
CELLS = np.concatenate([layer * CHUNK_CELLS + np.arange(0, CHUNK_CELLS, 29) for layer in LAYERS])
FIRST = NOW - 48 * HOUR
BOX = (1.5, 0.0, 0.0, 2.5, 16.0, 8.0)
"""Half a metre a cell: layers 3 and 4, half of each."""
MOST = 4 * CHUNK_CELLS
SOME = [30749, 5, 3072, 3072]
"""The second was never seen."""
FACTS = ("cell", "probability", "state", "verdict", "observed", "observed_time", "last_seen")


def fill(ctx: Context) -> None:
    """Two days of looks at the cells, a third of which are occupied by day; and one of today that is surprising."""
    make_location(ctx, "hall", SHAPE, interval_s=HOUR, estimator="fft", order=2, confidence=0.8)
    for hour in range(48):
        day = 8 <= hour % 24 < 18
        post_rows(ctx, "hall", [(FIRST + hour * HOUR, cell, int(day and cell % 3 == 0)) for cell in CELLS.tolist()])
    refit(ctx, "hall")
    compact_now(ctx, "hall")
    post_rows(ctx, "hall", [(NOW - 60.0, int(cell), 1) for cell in CELLS[:9]])


@pytest.fixture(scope="module")
def both(databases: Any) -> Iterator[tuple[Context, Context]]:
    """The same in a location that is held as a whole, and in one that is not."""
    with (
        databases.migrated() as one,
        databases.migrated() as other,
        opened(one) as whole,
        opened(other, whole_cells=MOST) as large,
    ):
        fill(whole)
        fill(large)
        yield whole, large


def answers(view: StateView) -> list[Any]:
    return [None if (column := getattr(view, name)) is None else column.tolist() for name in FACTS]


QUESTIONS = {
    "of the model": StateQuery(NOW, bbox=BOX),
    "given what was read": StateQuery(NOW + HOUR, bbox=BOX, given="observations"),
    "with what was seen": StateQuery(NOW, bbox=BOX, observed=True, last_seen=True, given="observations"),
    "of the past": StateQuery(NOW, bbox=BOX, as_of=FIRST + 9 * HOUR, given="observations", observed=True),
    "at a lower order": StateQuery(NOW, bbox=BOX, order=1),
    "by another estimator": StateQuery(NOW, bbox=BOX, estimator="calendar"),
    "about nothing": StateQuery(NOW, bbox=(5.0, 0.0, 0.0, 9.0, 16.0, 16.0), given="observations"),
    "of all that was seen": StateQuery(NOW, given="observations"),
}


@pytest.mark.parametrize("asked", QUESTIONS.values(), ids=QUESTIONS)
def test_a_region_is_answered_alike(both: tuple[Context, Context], asked: StateQuery) -> None:
    whole, large = (state_at(ctx, "hall", asked) for ctx in both)
    assert answers(whole) == answers(large)
    assert len(large.cell) or asked.bbox != BOX


OTHERS: dict[str, Callable[[Context], Any]] = {
    "some cells": lambda ctx: np.nan_to_num(
        predict_at(ctx, "hall", PredictQuery([NOW, NOW + HOUR], SOME, given="observations")).probability, nan=-1
    ).tolist(),
    "a series": lambda ctx: series(ctx, "hall", SeriesQuery(3072)).probability.tolist(),
    "one that was never seen": lambda ctx: np.isnan(series(ctx, "hall", SeriesQuery(5)).probability).all(),
    "a model": lambda ctx: model_of(ctx, "hall", 3072).spectrum.coefficient.tolist(),
    "information": lambda ctx: information_at(ctx, "hall", InformationQuery(best=2, bbox=BOX)).information.tolist(),
    "events": lambda ctx: [each.cells.tolist() for each in list_events(ctx, EventQuery())],
    "a search": lambda ctx: [e.cells.tolist() for e in detect(ctx, "hall", DetectQuery(FIRST, NOW, 0.6))[0]],
    "an evaluation": lambda ctx: evaluate(ctx, "hall", EvaluateQuery(orders=[1, 2])).best,
    "a history": lambda ctx: history_of(ctx, "hall", 3, 0, 9).observed.tolist(),
}


@pytest.mark.parametrize("ask_", OTHERS.values(), ids=OTHERS)
def test_other_questions_are_answered_alike(both: tuple[Context, Context], ask_: Callable[[Context], Any]) -> None:
    whole, large = map(ask_, both)
    assert whole == large


def test_only_what_was_seen_is_stored_and_only_what_is_asked_for_loaded(
    both: tuple[Context, Context], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, large = both
    found: list[Finding] = []
    assert verify(large.settings.url, found.append).blobs
    assert found == []
    large.caches.spectra.drop(lambda key: True)
    loaded: list[int] = []

    def noted(parts: Sequence[Spectrum]) -> Spectrum:
        loaded.append(sum(part.n_cells for part in parts))
        return concatenate(parts)

    monkeypatch.setattr(spectra, "concatenate", noted)
    model = ask(large, "hall", StateQuery(NOW, bbox=BOX)).model
    assert (list(model.held_chunks), loaded) == ([3, 4], [2 * CHUNK_CELLS])
    with large.store.read() as work:
        revision = work.spectra.get(model.location.id, 1)
    assert revision is not None
    assert revision.chunks is not None
    assert revision.chunks.tolist() == list(LAYERS)


WHOLE: dict[str, Callable[[Context], Any]] = {
    "a dense grid": lambda ctx: grid_of(ctx, ask(ctx, "hall", StateQuery(NOW, bbox=BOX))),
    "a file": lambda ctx: export_map(ctx, "hall", ExportQuery("ply", NOW), lambda: None),
    "the viewer": lambda ctx: map_at(ctx, MapQuery("hall", NOW)),
}


@pytest.mark.parametrize("ask_", WHOLE.values(), ids=WHOLE)
def test_what_is_about_all_of_it_says_how_to_ask_for_a_region(
    both: tuple[Context, Context], ask_: Callable[[Context], Any]
) -> None:
    _, large = both
    with pytest.raises(InvalidInputError, match=r"40960 cells, too many .* by bbox"):
        ask_(large)
    assert buffer_of(large, ask(large, "hall", StateQuery(NOW))) is None


def test_a_region_may_hold_too_much(both: tuple[Context, Context]) -> None:
    _, large = both
    smaller = replace(large, settings=large.settings.model_copy(update={"whole_cells": 2 * CHUNK_CELLS}))
    with pytest.raises(InvalidInputError, match=r"3072 cells would be loaded, more than .* by bbox"):
        state_at(smaller, "hall", StateQuery(NOW))
    assert len(state_at(smaller, "hall", StateQuery(NOW, bbox=BOX)).cell)
