"""Columns: measurements as they were sent, before they are checked, with the names of their places."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import FieldError, InvalidInputError
from tidemap.schemas.common import parse_time

Content: TypeAlias = bytes | bytearray
Integers: TypeAlias = NDArray[np.integer]


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """time, cell, state (n,); the functions name the place of row i as the sender knows it, `whole` the body.

    Arrays may be views of the body: nothing is copied before it is checked.
    """

    time: NDArray[np.float64]
    cell: Integers
    state: Integers
    time_field: Callable[[int], str]
    cell_field: Callable[[int], str]
    state_field: Callable[[int], str]
    whole: str


def wanted(kind: str) -> list[str]:
    """The columns of a table of measurements."""
    return ["state", "time"] if kind == "state" else ["cell", "state", "time"]


def of_table(time: NDArray[np.float64], cell: Integers | None, state: Integers) -> Columns:
    """The columns of a table, one row a measurement; without `cell` all are of a location's only one."""
    cells = np.broadcast_to(np.uint32(0), len(time)) if cell is None else cell
    cell_field = ("time[{}]" if cell is None else "cell[{}]").format
    return Columns(time, cells, state, "time[{}]".format, cell_field, "state[{}]".format, "time")


def misnamed(names: list[str], kind: str) -> list[FieldError]:
    """What is wrong with the names of a table's columns."""
    known = wanted(kind)
    errors = [
        FieldError(name, f"this column is not known here; send {', '.join(known)}")
        for name in dict.fromkeys(names)
        if name not in known
    ]
    errors += [FieldError(name, "this column is missing") for name in known if name not in names]
    return errors + [FieldError(name, "this column stands twice") for name in known if names.count(name) > 1]


def times_of(values: list[object], field: str, first: int = 0) -> NDArray[np.float64]:
    """Unix seconds of a list of numbers or ISO strings, whose first item is item `first` of the field.

    Raises InvalidInputError naming the first bad one.
    """
    array = numbers(values)
    if array is not None and array.dtype.kind in "if":
        return array.astype(np.float64)
    times = np.empty(len(values))
    for i, value in enumerate(values):
        times[i] = time_of(value, f"{field}[{first + i}]")
    return times


def time_of(value: object, field: str) -> float:
    """Unix seconds of one value. Raises InvalidInputError naming the field."""
    try:
        return parse_time(value)
    except ValueError as error:
        raise InvalidInputError.at(field, str(error)) from None


def integers_of(values: list[object], field: str, message: str, first: int = 0) -> NDArray[np.int64]:
    """Whole numbers of a list, whose first item is item `first` of the field.

    Raises InvalidInputError naming the first that is none.
    """
    array = numbers(values)
    if array is not None and array.dtype.kind in "iu":
        return array.astype(np.int64)
    return np.array([whole(value, f"{field}[{i}]", message) for i, value in enumerate(values, first)], np.int64)


def whole(value: object, field: str, message: str) -> int:
    """The value, if it is a whole number. Raises InvalidInputError naming the field."""
    if isinstance(value, bool) or not isinstance(value, int) or not -(2**62) < value < 2**62:
        raise InvalidInputError.at(field, message)
    return value


def numbers(values: list[object]) -> NDArray[np.generic] | None:
    """The list as a one-dimensional array of one numeric kind, None where it is no such.

    Only numbers go to numpy, which would give every row the length of the longest text.
    """
    if not set(map(type, values)) <= {int, float}:
        return None
    array = np.asarray(values) if values else np.empty(0, np.int64)
    return array if array.dtype.kind in "iuf" else None
