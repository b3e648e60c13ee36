"""The formats by media type: bodies to columns, and columns to answers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import xxhash

from tidemap.errors import InvalidInputError, UnsupportedMediaTypeError
from tidemap.formats import arrow, json_columns, npy
from tidemap.formats.table import Column
from tidemap.history.columns import Columns, Content
from tidemap.media_types import ARROW, JSON, NPY
from tidemap.space.grid import GridGeometry


@dataclass(frozen=True, slots=True)
class Reader:
    """`read` gives the columns of a body for a location's grid. `cost` as `Body.cost`."""

    read: Callable[[Content, GridGeometry], Columns]
    cost: int


READERS = {JSON: Reader(json_columns.read, 24), ARROW: Reader(arrow.read, 12), NPY: Reader(npy.read, 12)}
GRID_COST = 13 * READERS[NPY].cost
"""`Body.cost` of a grid, where one byte is a measurement, which takes 13 in a table."""
WRITERS: Mapping[str, Callable[[Mapping[str, Any], Mapping[str, Column]], Sequence[bytes | memoryview]]] = {
    JSON: lambda facts, columns: json_columns.write({**facts, **columns}),
    ARROW: lambda facts, columns: [arrow.write(facts, columns)],
}
"""Of an answer that is facts (plain values) and equally long columns."""


@dataclass(frozen=True)
class Body:
    """The unpacked bytes of a post, their media type, and the time of all that is in them where that is sent beside."""

    content: Content
    media_type: str
    time: float | None = None

    @cached_property
    def digest(self) -> bytes:
        """What distinguishes two bodies, 128 bits; a fifth of the cost of SHA-256, and no secret depends on it."""
        digest = xxhash.xxh3_128(self._beside.encode() + b"\0")
        digest.update(self.content)
        return digest.digest()

    @property
    def cost(self) -> int:
        """Bytes of memory that each byte of it takes at most until its measurements are stored; its own included."""
        if self.media_type == NPY and self.time is not None:
            return GRID_COST
        return READERS[self.media_type].cost if self.media_type in READERS else 1

    @property
    def _beside(self) -> str:
        return self.media_type if self.time is None else f"{self.media_type} {self.time!r}"


def read(body: Body, grid: GridGeometry) -> Columns:
    """The measurements of a body as they were sent, for a location of this grid.

    Raises UnsupportedMediaTypeError, UnreadableBodyError, InvalidInputError.
    """
    reader = READERS.get(body.media_type)
    if reader is None:
        raise UnsupportedMediaTypeError(
            f"Content-Type {body.media_type!r} is not read here; send one of {', '.join(READERS)}."
        )
    if body.time is None:
        return reader.read(body.content, grid)
    if body.media_type != NPY:
        raise InvalidInputError.at("time", f"only a grid as {NPY} has its time here; leave it out")
    return npy.read_grid(body.content, grid, body.time)
