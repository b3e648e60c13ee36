"""Questions about some cells at many times (Eq. 3)."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CellNotFoundError, InvalidInputError
from tidemap.formats.json_columns.small import cells_of
from tidemap.history.history import UNOBSERVED
from tidemap.services.context import Context
from tidemap.services.given import Given, Known, known_at
from tidemap.services.locations import find_location
from tidemap.services.parts import Cells
from tidemap.services.spectra import Fitted, fitted
from tidemap.spectral.prediction import entropy, predict_times, state
from tidemap.spectral.spectrum import Spectrum
from tidemap.storage.records import LocationRecord

BLOCK_VALUES = 1 << 16
"""Probabilities between two looks whether anybody still waits for them."""


@dataclass(frozen=True, slots=True, eq=False)
class PredictionView:
    """time (n_t,), cell (n_c,); probability, state and entropy (n_c, n_t), NaN and 2 where never observed.

    unavailable: ranges [first, stop) of cells whose spectrum is damaged: they look as if never observed.
    """

    time: NDArray[np.float64]
    cell: NDArray[np.int64]
    confidence: float
    probability: NDArray[np.float32]
    state: NDArray[np.uint8]
    entropy: NDArray[np.float64]
    revision: int
    unavailable: list[tuple[int, int]]
    as_of: float
    given: Given


@dataclass(frozen=True, slots=True)
class PredictQuery:
    """A question for many times; `cell` None asks for all cells, each linear or [i,j,k].

    `as_of` and `given` are as of a `StateQuery`.
    """

    time: list[float]
    cell: Sequence[int | Sequence[int]] | None = None
    confidence: float | None = None
    order: int | None = None
    estimator: str | None = None
    as_of: float | None = None
    given: Given = "model"


def predict_at(
    ctx: Context, name: str, query: PredictQuery, check: Callable[[], None] = lambda: None
) -> PredictionView:
    """`check` is called between blocks; what it raises ends this.

    Of all cells those that are unavailable look as if never observed; to name one of them is an error.

    Raises LocationNotFoundError, NoModelError, CellNotFoundError, CorruptChunkError, InvalidInputError when it asks for
    too much.
    """
    location = find_location(ctx, name)
    cell = _cells(ctx, location, query)
    model = fitted(ctx, name, query.estimator, query.order, part=Cells(cell))
    if query.cell is not None:
        model.check_readable(cell)
    confidence = model.location.confidence if query.confidence is None else query.confidence
    time = np.asarray(query.time, np.float64)
    as_of = ctx.clock() if query.as_of is None else query.as_of
    known = _known_of(ctx, model, cell, as_of) if query.given == "observations" else None
    probability = predict_in_blocks(model.spectrum, time, model.rows(cell), check, known)
    return PredictionView(
        time,
        cell,
        confidence,
        probability,
        state_or_unknown(probability, confidence),
        entropy(probability),
        model.revision.revision,
        model.unavailable if known is None else model.location.cell_ranges({*model.damage, *known.damaged}),
        as_of,
        query.given,
    )


def _known_of(ctx: Context, model: Fitted, cells: NDArray[np.int64], as_of: float) -> Known:
    """What was known of cells in any order, and each as often as it is named."""
    distinct, rows = np.unique(cells, return_inverse=True)
    return known_at(ctx, model, distinct, as_of).rows(rows)


def predict_in_blocks(
    spectrum: Spectrum,
    time: NDArray[np.float64],
    cells: NDArray[np.int64],
    check: Callable[[], None],
    known: Known | None = None,
) -> NDArray[np.float32]:
    """As `predict_times`, (n_cells, n_times), given what is known of the cells; `check` as of `predicted_blocks`."""
    out = np.empty((len(cells), len(time)), np.float32)
    for part, p in predicted_blocks(spectrum, time, cells, check, known):
        out[:, part] = p
    return out


def predicted_blocks(
    spectrum: Spectrum,
    time: NDArray[np.float64],
    cells: NDArray[np.int64],
    check: Callable[[], None],
    known: Known | None = None,
) -> Iterator[tuple[slice, NDArray[np.float32]]]:
    """Blocks of times, and the probability of the cells in them (n_cells, n_block); `check` is called before each."""
    step = max(1, BLOCK_VALUES // max(1, len(cells)))
    for first in range(0, len(time), step):
        check()
        part = slice(first, first + step)
        p = predict_times(spectrum, time[part], cells)
        yield part, p if known is None else known.condition(p, time[part])


def _cells(ctx: Context, location: LocationRecord, query: PredictQuery) -> NDArray[np.int64]:
    """Those that are asked for. Raises CellNotFoundError, InvalidInputError."""
    n_points = (location.n_cells if query.cell is None else len(query.cell)) * len(query.time)
    if n_points > ctx.settings.max_points:
        raise InvalidInputError.at(
            "time", f"{n_points} values are more than {ctx.settings.max_points}; ask for fewer times or cells"
        )
    if query.cell is None:
        return np.arange(location.n_cells)
    found = cells_of(list(query.cell), "cell", location.cells)
    outside = np.flatnonzero((found < 0) | (found >= location.n_cells))
    if outside.size:
        raise CellNotFoundError(query.cell[outside[0]], location.n_cells)
    return found


def check_cell(location: LocationRecord, cell: int) -> None:
    """Raises CellNotFoundError."""
    if not 0 <= cell < location.n_cells:
        raise CellNotFoundError(cell, location.n_cells)


def state_or_unknown(probability: NDArray[np.float32], confidence: float) -> NDArray[np.uint8]:
    """The state, UNOBSERVED where p is NaN."""
    return np.where(np.isnan(probability), np.uint8(UNOBSERVED), state(probability, confidence))
