"""CSV: tables with names in their first line."""

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import UnreadableBodyError
from tidemap.schemas.common import parse_time, parse_time_text

DELIMITERS = ",;\t "


def read(content: bytes, wanted: Sequence[str]) -> Mapping[str, list[str]]:
    """Some columns of a table by name, as text. Raises UnreadableBodyError.

    The delimiter is that of the first line: comma, semicolon, tab or space.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise unreadable(f"byte {error.start} is no UTF-8") from None
    lines = io.StringIO(text, newline="")
    delimiter = _delimiter(lines.readline())
    lines.seek(0)
    rows = csv.reader(lines, delimiter=delimiter)
    names = _names(rows)
    if missing := [name for name in wanted if names.count(name) != 1]:
        raise unreadable(
            f"it has no column {missing[0]!r}, or several; its columns are {', '.join(names)[:200]!r}. "
            "Add it, or name the right one"
        )
    return _columns(rows, names, wanted)


def write(columns: Mapping[str, Sequence[object]]) -> bytes:
    """A table with the names of equally long columns in its first line; None is an empty field.

    >>> write({"time_s": [0.5, 60.0], "note": ["a, b", None]})
    b'time_s,note\\n0.5,"a, b"\\n60.0,\\n'
    """
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows(zip(*columns.values(), strict=True))
    return text.getvalue().encode()


def times(texts: Sequence[str]) -> NDArray[np.float64]:
    """Unix seconds (n,) of times in seconds or in ISO 8601 with a zone. Raises UnreadableBodyError."""
    found = np.empty(len(texts))
    for row, text in enumerate(texts):
        try:
            found[row] = _seconds(text.strip())
        except ValueError as error:
            raise unreadable(f"row {row + 1} has the time {text[:40]!r}: {error}") from None
    return found


def numbers(name: str, texts: Sequence[str]) -> NDArray[np.float64]:
    """A column of finite numbers, (n,). Raises UnreadableBodyError."""
    try:
        found = np.array(texts, np.float64)
    except ValueError as error:
        raise unreadable(f"its column {name!r} has what is no number: {str(error)[:100]}") from None
    if not np.isfinite(found).all():
        raise unreadable(f"its column {name!r} has NaN or infinity. Leave those rows out")
    return found


def unreadable(why: str) -> UnreadableBodyError:
    """What is raised for a table that cannot be read."""
    return UnreadableBodyError(f"This CSV file cannot be read: {why}.")


def _seconds(text: str) -> float:
    """Digits alone are seconds here: a column of times is no text that somebody typed."""
    try:
        seconds = float(text)
    except ValueError:
        return parse_time_text(text)
    return parse_time(seconds)


def _delimiter(head: str) -> str:
    return next((each for each in DELIMITERS if each in head), ",")


def _names(reader: Any) -> list[str]:
    try:
        return [name.strip() for name in next(reader, [])]
    except csv.Error as error:
        raise unreadable(f"line 1: {error}") from None


def _columns(reader: Any, names: list[str], wanted: Sequence[str]) -> Mapping[str, list[str]]:
    at = [names.index(name) for name in wanted]
    found: dict[str, list[str]] = {name: [] for name in wanted}
    try:
        for row in reader:
            if not row:
                continue
            if len(row) != len(names):
                raise unreadable(f"line {reader.line_num} has {len(row)} fields, but the first has {len(names)}")
            for name, column in zip(wanted, at, strict=True):
                found[name].append(row[column])
    except csv.Error as error:
        raise unreadable(f"line {reader.line_num}: {error}") from None
    return found
