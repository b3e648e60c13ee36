"""JSON observations, parsed columnar."""

import json
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from tidemap.errors import FieldError, InvalidInputError, UnreadableBodyError
from tidemap.formats.json_columns.values import integers_of, states_of, time_of, times_of, whole
from tidemap.history.columns import STATE_MESSAGE, Columns, Content, of_table
from tidemap.space.grid import GridGeometry

CELL_MESSAGE = "a cell is its linear index or [i,j,k]"
NAMES = ("occupied", "free", "unavailable")
"""What an observation says of cells."""


def read(content: Content, grid: GridGeometry) -> Columns:
    """Columns of a JSON body. Raises UnreadableBodyError, InvalidInputError."""
    document = _load(content)
    if not isinstance(document, dict):
        raise InvalidInputError.at("body", "send a JSON object")
    return _state(document) if grid.is_single else _grid(document, grid)


def _load(content: Content) -> Any:
    try:
        return orjson.loads(content)
    except orjson.JSONDecodeError as error:
        _refuse_nonfinite(content)
        raise UnreadableBodyError(f"The body is no JSON: {error}.") from None


def _refuse_nonfinite(content: Content) -> None:
    """NaN and Infinity are no JSON, but many writers send them: name the path."""
    try:
        document = json.loads(content, parse_constant=_NonFinite)
    except (ValueError, RecursionError):
        return
    path = _find_nonfinite(document, "body")
    if path is not None:
        printable = path.removeprefix("body.").encode(errors="replace").decode()
        raise InvalidInputError.at(printable, "NaN and infinity are no values here; send a number")


class _NonFinite(str):
    """Stands for NaN or an infinity."""


def _find_nonfinite(value: object, path: str) -> str | None:
    if isinstance(value, _NonFinite):
        return path
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inside:
        found = _find_nonfinite(item, f"{path}[{key}]" if isinstance(value, list) else f"{path}.{key}")
        if found is not None:
            return found
    return None


def _check_fields(value: dict[str, Any], path: str, required: set[str], allowed: set[str]) -> None:
    prefix = f"{path}." if path else ""
    errors = [
        FieldError(f"{prefix}{name}", f"this field is not known; known are {', '.join(sorted(allowed))}")
        for name in value
        if name not in allowed
    ]
    errors += [FieldError(f"{prefix}{name}", "this field is missing") for name in sorted(required - value.keys())]
    if errors:
        raise InvalidInputError(*errors)


def _list(value: object, field: str) -> list[object]:
    if not isinstance(value, list):
        raise InvalidInputError.at(field, "send a list")
    return value


def _state(document: dict[str, Any]) -> Columns:
    _check_fields(document, "", {"time", "state"}, {"time", "state"})
    times = times_of(_list(document["time"], "time"), "time")
    states, unavailable = states_of(_list(document["state"], "state"), "state", STATE_MESSAGE)
    check_lengths(times, states)
    return of_table(times, None, states, unavailable)


def check_lengths(times: NDArray[np.float64], states: NDArray[np.int64]) -> None:
    """Raises InvalidInputError where there are not as many of both."""
    if len(times) != len(states):
        raise InvalidInputError.at(
            "state", f"it has {len(states)} values and time has {len(times)}; they must be of one length"
        )


def _grid(document: dict[str, Any], grid: GridGeometry) -> Columns:
    _check_fields(document, "", {"observations"}, {"observations"})
    times: list[float] = []
    parts: list[NDArray[np.int64]] = []
    origins: list[tuple[int, str]] = []
    for i, item in enumerate(_list(document["observations"], "observations")):
        path = f"observations[{i}]"
        if not isinstance(item, dict):
            raise InvalidInputError.at(path, "send an object with time, occupied and free")
        _check_fields(item, path, {"time"}, {"time", *NAMES})
        times.append(time_of(item["time"], f"{path}.time"))
        for name in NAMES:
            field = f"{path}.{name}"
            cells = cells_of(_list(item.get(name, []), field), field, grid)
            if len(cells):
                parts.append(cells)
                origins.append((i, name))
    return assemble(np.array(times, np.float64), parts, origins)


def assemble(times: NDArray[np.float64], parts: list[NDArray[np.int64]], origins: list[tuple[int, str]]) -> Columns:
    """The columns of all parts: the cells of one state in one observation; their origin is that one and its field."""
    lengths = np.array([len(part) for part in parts], np.int64)
    first = np.concatenate([[0], np.cumsum(lengths)])
    owner = np.repeat(np.arange(len(parts)), lengths)
    observation = np.array([i for i, _ in origins], np.int64)
    occupied = np.array([name == "occupied" for _, name in origins], np.uint8)
    unavailable = np.array([name == "unavailable" for _, name in origins], np.bool_)

    def cell_field(row: int) -> str:
        part = int(owner[row])
        i, name = origins[part]
        return f"observations[{i}].{name}[{row - int(first[part])}]"

    return Columns(
        times[observation[owner]],
        np.concatenate(parts) if parts else np.empty(0, np.int64),
        occupied[owner],
        lambda row: f"observations[{origins[int(owner[row])][0]}].time",
        cell_field,
        cell_field,
        "observations",
        unavailable[owner] if unavailable.any() else None,
    )


def cells_of(values: list[object], field: str, grid: GridGeometry) -> NDArray[np.int64]:
    """Linear cells; [i,j,k] outside of the grid become -1. Both forms may stand in one list."""
    kinds = set(map(type, values))
    if list not in kinds:
        return integers_of(values, field, CELL_MESSAGE)
    if kinds == {list}:
        return _indices(values, field, grid)
    cells = np.empty(len(values), np.int64)
    listed = [i for i, value in enumerate(values) if isinstance(value, list)]
    cells[listed] = _indices([values[i] for i in listed], field, grid)
    for i, value in enumerate(values):
        if not isinstance(value, list):
            cells[i] = whole(value, f"{field}[{i}]", CELL_MESSAGE)
    return cells


def _indices(values: list[object], field: str, grid: GridGeometry) -> NDArray[np.int64]:
    """Linear cells of lists [i,j,k]."""
    axes = len(grid.shape)
    try:
        index = np.array(values, np.int64)
    except (ValueError, TypeError, OverflowError):
        index = np.empty((0, 0), np.int64)
    if index.shape != (len(values), axes) or not _all_whole(values):
        raise InvalidInputError.at(field, f"cells as indices are lists of {axes} whole numbers each; {CELL_MESSAGE}")
    index = np.pad(index, ((0, 0), (0, 3 - axes)))
    inside = ((index >= 0) & (index < grid.shape3)).all(axis=1)
    cells = np.full(len(index), -1, np.int64)
    cells[inside] = grid.cell(index[inside])
    return cells


def _all_whole(values: list[object]) -> bool:
    return all(isinstance(value, list) and all(type(item) is int for item in value) for value in values)
