"""Columns: measurements as they were sent, before they are checked, with the names of their fields."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import FieldError

Content: TypeAlias = bytes | bytearray
Integers: TypeAlias = NDArray[np.integer]
STATE_MESSAGE = "a state is 0 (free) or 1 (occupied), or null where the sensor is unavailable"


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """time, cell, state (n,); the functions name the field of row i as the sender knows it, `whole` names the body.

    unavailable (n,): where the sensor does not know the state, and `state` is 0; None where it is nowhere.

    Arrays may be views of the body: nothing is copied before it is checked.
    """

    time: NDArray[np.float64]
    cell: Integers
    state: Integers
    time_field: Callable[[int], str]
    cell_field: Callable[[int], str]
    state_field: Callable[[int], str]
    whole: str
    unavailable: NDArray[np.bool_] | None = None


def of_table(
    time: NDArray[np.float64], cell: Integers | None, state: Integers, unavailable: NDArray[np.bool_] | None = None
) -> Columns:
    """The columns of a table, one row a measurement; without `cell` all are of a location's only one."""
    cells = np.broadcast_to(np.uint32(0), len(time)) if cell is None else cell
    cell_field = ("time[{}]" if cell is None else "cell[{}]").format
    return Columns(time, cells, state, "time[{}]".format, cell_field, "state[{}]".format, "time", unavailable)


def misnamed(names: list[str], known: list[str]) -> list[FieldError]:
    """What is wrong with the names of a table's columns, which are to be those `known`."""
    errors = [
        FieldError(name, f"this column is not known here; send {', '.join(known)}")
        for name in dict.fromkeys(names)
        if name not in known
    ]
    errors += [FieldError(name, "this column is missing") for name in known if name not in names]
    return errors + [FieldError(name, "this column stands twice") for name in known if names.count(name) > 1]
