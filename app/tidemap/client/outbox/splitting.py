"""Splitting: a batch that is refused for some of its measurements is sent in halves, so that the others go through."""

import io
import json
import re
from dataclasses import replace

import numpy as np

from tidemap.client import arrow, npy
from tidemap.client.posting import Batch
from tidemap.media_types import ARROW, JSON, NPY

MAX_HALVINGS = 10
"""So often is a part of a batch halved: of one that is wrong throughout, at most 1,024 parts are tried."""
_HALVED = re.compile(r"(?:-[ab])*$")
Half = tuple[bytes, int]
"""The content of a half, and how many measurements it holds."""


def halves(batch: Batch) -> tuple[Batch, Batch] | None:
    """A batch as two, cut between times, each under a key of its own.

    None where all of it is of one time, where it is a small enough part of what was one, and where it is written in a
    form that is not known here.
    """
    tail = _HALVED.search(batch.key)
    if tail is not None and len(tail[0]) >= 2 * MAX_HALVINGS:
        return None
    split = {NPY: _of_npy, ARROW: _of_arrow, JSON: _of_json}.get(batch.content_type)
    try:
        parts = None if split is None else split(batch.content)
    except (ValueError, KeyError, TypeError, EOFError):
        # Another version of the client wrote it otherwise.
        parts = None
    if parts is None:
        return None
    first, second = (
        replace(batch, content=content, measurements=count, key=f"{batch.key}-{name}")
        for name, (content, count) in zip("ab", parts, strict=True)
    )
    return first, second


def _cut(times: np.ndarray[tuple[int], np.dtype[np.float64]]) -> int | None:
    """Where to cut times that ascend: between two different ones, as near to the middle as can be."""
    starts = np.flatnonzero(np.diff(times)) + 1
    return int(starts[np.abs(starts - len(times) / 2).argmin()]) if len(starts) else None


def _of_npy(content: bytes) -> tuple[Half, Half] | None:
    rows = np.load(io.BytesIO(content), allow_pickle=False)
    cut = _cut(rows["time"]) if rows.dtype.names else None
    if cut is None:
        return None
    return (npy.write(rows[:cut]), cut), (npy.write(rows[cut:]), len(rows) - cut)


def _of_arrow(content: bytes) -> tuple[Half, Half] | None:
    if arrow.pa is None:
        return None
    columns = arrow.read_columns(content)
    times = columns["time"]
    cut = _cut(times)
    if cut is None:
        return None
    first, second = ({name: each[part] for name, each in columns.items()} for part in (slice(cut), slice(cut, None)))
    return (arrow.write(first), cut), (arrow.write(second), len(times) - cut)


def _of_json(content: bytes) -> tuple[Half, Half] | None:
    observations = json.loads(content)["observations"]
    middle = len(observations) // 2
    if not middle:
        return None
    first, second = (
        (
            json.dumps({"observations": part}, separators=(",", ":")).encode(),
            sum(len(each.get(name, ())) for each in part for name in ("occupied", "free", "unavailable")),
        )
        for part in (observations[:middle], observations[middle:])
    )
    return first, second
