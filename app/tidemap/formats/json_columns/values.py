"""Values of JSON: lists of times and whole numbers to arrays, naming the first value that is wrong."""

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError
from tidemap.schemas.common import parse_time


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


def states_of(
    values: list[object], field: str, message: str, first: int = 0
) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
    """Whole numbers of a list as `integers_of`, 0 where it has null, and where that is; None where it is nowhere."""
    if None not in values:
        return integers_of(values, field, message, first), None
    missing = np.array([value is None for value in values])
    return integers_of([0 if value is None else value for value in values], field, message, first), missing


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
