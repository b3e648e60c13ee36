"""Clouds: what all files of points have in common."""

import io
import re
from collections import deque
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import UnreadableBodyError
from tidemap.history.columns import Content

Points: TypeAlias = NDArray[np.float32]

MAX_POINTS = 2_000_000
"""Points of a file; a sweep of a lidar has some 100,000."""
MAX_HEAD_BYTES = 65_536
"""Bytes of the longest header that is read."""
MAX_ROW_BYTES = 4096
"""Bytes of one point with all its fields."""
AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class CloudField:
    """`count` numbers of one type."""

    name: str
    dtype: np.dtype[Any]
    count: int = 1


@dataclass(frozen=True)
class CloudLayout:
    """The fields of a row in their order. `file` names the kind of file in errors."""

    file: str
    fields: tuple[CloudField, ...]

    @cached_property
    def row_bytes(self) -> int:
        """Bytes of a row."""
        return sum(field.dtype.itemsize * field.count for field in self.fields)

    @cached_property
    def columns(self) -> int:
        """Numbers in a row."""
        return sum(field.count for field in self.fields)

    def check(self) -> None:
        """Raises UnreadableBodyError unless x, y and z are there once, as floating-point numbers."""
        for name in AXES:
            found = [field for field in self.fields if field.name == name]
            if len(found) != 1 or found[0].count != 1:
                raise unreadable(self.file, f"it has {len(found)} fields {name}; write each point with x, y and z once")
            if found[0].dtype.kind != "f":
                raise unreadable(self.file, f"its {name} is {found[0].dtype.name}; write float32 or float64")
        if self.row_bytes > MAX_ROW_BYTES:
            raise unreadable(
                self.file, f"a point has {self.row_bytes} bytes; leave fields out, at most {MAX_ROW_BYTES} are read"
            )

    def before(self, name: str) -> tuple[CloudField, ...]:
        """The fields in front of this one."""
        names = [field.name for field in self.fields]
        return self.fields[: names.index(name)]

    def packed(self, content: Content, start: int, n: int) -> Points:
        """Points (n, 3) of rows that stand in `content` from `start` on, and are all there."""
        offsets = [CloudLayout(self.file, self.before(name)).row_bytes for name in AXES]
        rows = np.ndarray(
            n,
            np.dtype({"names": AXES, "formats": self.axis_types, "offsets": offsets, "itemsize": self.row_bytes}),
            content,
            start,
        )
        return stacked([rows[name] for name in AXES])

    def planar(self, content: memoryview, n: int) -> Points:
        """Points (n, 3) of content that has all values of the first field, then all of the second, and so on."""
        offsets = [n * CloudLayout(self.file, self.before(name)).row_bytes for name in AXES]
        return stacked([np.ndarray(n, *each) for each in zip(self.axis_types, [content] * 3, offsets, strict=True)])

    def text(self, content: Content, start: int, n: int, *, skip: int = 0, more: bool = False) -> Points:
        """Points (n, 3) of lines from `start` on, behind `skip` others and with `more` lines behind them or none."""
        if n == 0:
            return np.empty((0, 3), np.float32)
        rows = self._rows_of_text(content, start, skip)
        if n * 2 * self.columns > len(rows) + 1:  # a digit and a space each
            raise unreadable(self.file, f"it declares {n} points, but is too short for them. Send the whole file")
        lines = islice(io.BytesIO(rows), n + (not more))
        columns = [CloudLayout(self.file, self.before(name)).columns for name in AXES]
        try:
            with np.errstate(over="ignore"):
                found = np.loadtxt(lines, np.float32, comments=None, usecols=columns, ndmin=2, encoding="ascii")
        except (ValueError, OverflowError) as error:
            raise unreadable(self.file, f"its lines are no points: {str(error)[:200]}") from None
        if len(found) != n:
            raise unreadable(self.file, f"it declares {n} points, but other than {n} lines of numbers follow")
        return found

    def _rows_of_text(self, content: Content, start: int, skip: int) -> bytes:
        """The lines from `start` on, without the first `skip`: at least one, of printable characters."""
        if skip > MAX_POINTS:
            raise unreadable(self.file, f"{skip} rows stand before its points; write the points first")
        lines = io.BytesIO(memoryview(content)[start:])
        deque(islice(lines, skip), maxlen=0)
        rows = lines.read().strip()
        if re.search(rb"[^\t\n\r -~]", rows) or not rows:
            raise unreadable(self.file, "its lines are no points: none follow, or they are no text")
        return rows

    @property
    def axis_types(self) -> list[np.dtype[Any]]:
        """The types of x, y and z."""
        return [field.dtype for name in AXES for field in self.fields if field.name == name]


ROW = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("probability", "<f4")])
"""Of the clouds that are written."""


def rows_of(points: NDArray[np.float64], probability: NDArray[np.float32]) -> NDArray[np.void]:
    """Points (n, 3) and their probability (n,) as rows of `ROW`."""
    rows = np.empty(len(points), ROW)
    for axis, name in enumerate(AXES):
        rows[name] = points[:, axis]
    rows["probability"] = probability
    return rows


def unreadable(file: str, why: str) -> UnreadableBodyError:
    """What is raised for a file that cannot be read."""
    return UnreadableBodyError(f"This {file} file cannot be read: {why}.")


def stacked(axes: list[NDArray[Any]]) -> Points:
    """x, y and z (n,) as points (n, 3); what float32 cannot hold becomes infinite."""
    found = np.empty((len(axes[0]), len(axes)), np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        for column, axis in enumerate(axes):
            found[:, column] = axis
    return found


def count_of(file: str, what: str, text: str, most: int = MAX_POINTS) -> int:
    """A whole number of a header, at most `most`. Raises UnreadableBodyError."""
    if not re.fullmatch(r"[0-9]{1,18}", text, re.ASCII):
        raise unreadable(file, f"its number of {what} is {text[:40]!r}; write a whole number")
    if int(text) > most:
        raise unreadable(file, f"it declares {int(text)} {what}; at most {most} are read, so send it in parts")
    return int(text)


def head_lines(file: str, content: Content, end: bytes) -> tuple[list[str], int]:
    """The lines of a header up to that with the first word `end`, and where the rows start.

    Raises UnreadableBodyError.
    """
    head = bytes(content[:MAX_HEAD_BYTES])
    last = re.search(rb"^" + end + rb"\b[^\n]*\n", head, re.MULTILINE)
    if last is None:
        raise unreadable(file, f"its first {len(head)} bytes have no line {end.decode()!r}, which ends the header")
    # Comments may be in any language.
    return head[: last.end()].decode("utf-8", "replace").replace("\r", "").split("\n")[:-1], last.end()
