"""Large JSON observations: the same columns as `small` makes, in pieces and without an object for every number."""

from collections.abc import Callable
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError
from tidemap.formats.json_columns.small import NAMES, assemble, cells_of, check_lengths
from tidemap.formats.json_columns.text import fields_of, list_parts, parsed
from tidemap.formats.json_columns.values import states_of, time_of, times_of
from tidemap.history.columns import STATE_MESSAGE, Columns, Content, of_table
from tidemap.space.grid import GridGeometry

MAX_OBSERVATIONS = 100_000
"""Observations in one post; each costs as much as hundreds of cells."""
_TIME = b'"time"'
Part = TypeVar("Part")


class _State(msgspec.Struct, forbid_unknown_fields=True):
    time: msgspec.Raw
    state: msgspec.Raw


class _Observation(msgspec.Struct, forbid_unknown_fields=True, gc=False):
    time: msgspec.Raw
    occupied: msgspec.Raw = msgspec.Raw(b"[]")
    free: msgspec.Raw = msgspec.Raw(b"[]")
    unavailable: msgspec.Raw = msgspec.Raw(b"[]")


class _Observations(msgspec.Struct, forbid_unknown_fields=True):
    observations: list[_Observation]


def read(content: Content, grid: GridGeometry) -> Columns:
    """Columns of a JSON body. Raises UnreadableBodyError, InvalidInputError."""
    return _state(content) if grid.is_single else _grid(content, grid)


def _state(content: Content) -> Columns:
    sent = fields_of(content, _State)
    times = np.concatenate(_column(sent.time, "time", times_of))
    parts = _column(sent.state, "state", lambda part, field, first: states_of(part, field, STATE_MESSAGE, first))
    states = np.concatenate([state for state, _ in parts])
    check_lengths(times, states)
    if all(missing is None for _, missing in parts):
        return of_table(times, None, states)
    unavailable = [np.zeros(len(state), np.bool_) if missing is None else missing for state, missing in parts]
    return of_table(times, None, states, np.concatenate(unavailable))


def _column(text: msgspec.Raw, field: str, read_part: Callable[[list[Any], str, int], Part]) -> list[Part]:
    """A list of values in parts."""
    parts: list[Part] = []
    first = 0
    for part in list_parts(bytes(text), field):
        parts.append(read_part(part, field, first))
        first += len(part)
    return parts


def _grid(content: Content, grid: GridGeometry) -> Columns:
    if content.count(_TIME) > MAX_OBSERVATIONS:
        raise InvalidInputError.at(
            "observations", f"more than {MAX_OBSERVATIONS} observations in one post; send them in several, or as Arrow"
        )
    times: list[float] = []
    parts: list[NDArray[np.int64]] = []
    origins: list[tuple[int, str]] = []
    for i, observation in enumerate(fields_of(content, _Observations).observations):
        times.append(time_of(parsed(bytes(observation.time)), f"observations[{i}].time"))
        for name in NAMES:
            field = f"observations[{i}].{name}"
            for part in list_parts(bytes(getattr(observation, name)), field):
                if part:
                    parts.append(cells_of(part, field, grid))
                    origins.append((i, name))
    return assemble(np.array(times, np.float64), parts, origins)
