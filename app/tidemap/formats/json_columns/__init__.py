"""JSON: observations as lists of values, and answers as an object of columns."""

from tidemap.formats.json_columns import large, small
from tidemap.formats.json_columns.parts import write
from tidemap.history.columns import Columns, Content
from tidemap.space.grid import GridGeometry

LARGE_BYTES = 1 << 18
"""Bodies from here on are read in pieces."""


def read(content: Content, grid: GridGeometry) -> Columns:
    """Columns of a JSON body. Raises UnreadableBodyError, InvalidInputError."""
    read_columns = small.read if len(content) < LARGE_BYTES else large.read
    return read_columns(content, grid)


__all__ = ["LARGE_BYTES", "read", "write"]
