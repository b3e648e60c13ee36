"""Parts of a location: the cells that a question is about, and the chunks that have to be loaded for it."""

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.services.context import Context
from tidemap.storage.records import LocationRecord


class LocationPart(Protocol):
    """Which cells of a location."""

    def chunks(self, location: LocationRecord, fitted: NDArray[np.int64]) -> NDArray[np.int64]:
        """The chunks that have them, ascending; `fitted` ones have a spectrum, of others nothing was ever seen."""
        ...


@dataclass(frozen=True, slots=True)
class Whole:
    """All of them, which only a location has that is not too large."""

    def chunks(self, location: LocationRecord, fitted: NDArray[np.int64]) -> NDArray[np.int64]:
        """Raises InvalidInputError."""
        raise too_large(location)


@dataclass(frozen=True, slots=True)
class SeenPart:
    """Those that have been observed."""

    def chunks(self, location: LocationRecord, fitted: NDArray[np.int64]) -> NDArray[np.int64]:
        """The fitted ones."""
        return fitted


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Some cells (n,), in any order."""

    cell: NDArray[np.integer]

    def chunks(self, location: LocationRecord, fitted: NDArray[np.int64]) -> NDArray[np.int64]:
        """Theirs, whether anything was seen there or not."""
        return np.unique(self.cell // CHUNK_CELLS).astype(np.int64)


@dataclass(frozen=True, slots=True)
class BoxPart:
    """Those in a box [x0, y0, z0, x1, y1, z1] in metres that have been observed."""

    bbox: tuple[float, ...]

    def chunks(self, location: LocationRecord, fitted: NDArray[np.int64]) -> NDArray[np.int64]:
        """The fitted ones in the box."""
        return np.intersect1d(location.cells.runs(self.bbox).chunks(CHUNK_CELLS), fitted, assume_unique=True)


WHOLE: Final = Whole()
SEEN: Final = SeenPart()


def in_box(bbox: tuple[float, ...] | None) -> LocationPart:
    """What was seen in a box, or without one everywhere."""
    return SEEN if bbox is None else BoxPart(bbox)


def is_whole(ctx: Context, location: LocationRecord) -> bool:
    """Whether a location is small enough to be loaded as a whole."""
    return location.n_cells <= ctx.settings.whole_cells


def refuse_large(ctx: Context, location: LocationRecord) -> None:
    """Raises InvalidInputError where a location is too large for a question about all of it."""
    if not is_whole(ctx, location):
        raise too_large(location)


def too_large(location: LocationRecord) -> InvalidInputError:
    """What is said of questions that are about a whole location only."""
    return InvalidInputError.at(
        "location",
        f"{location.name!r} has {location.n_cells} cells, too many to be taken as a whole; ask for the state of a "
        "region, by bbox",
    )


def check_size(ctx: Context, chunks: NDArray[np.int64]) -> None:
    """Raises InvalidInputError where chunks are too many to be held at once."""
    held, most = len(chunks) * CHUNK_CELLS, ctx.settings.whole_cells
    if held > most:
        raise InvalidInputError.at(
            "bbox",
            f"{held} cells would be loaded, more than this server's {most} at once; ask for a smaller region by bbox, "
            "or post less at once",
        )


def seen_chunks(ctx: Context, location: LocationRecord) -> NDArray[np.int64]:
    """The chunks of a location: all of them, of a large one those with compacted history."""
    if is_whole(ctx, location):
        return np.arange(location.n_chunks)
    with ctx.store.read() as work:
        return work.segments.chunks(location.id)
