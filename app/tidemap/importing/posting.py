"""Posting: looks in large posts, whose keys say from which file and where in it they are."""

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from tidemap.client import LocationHandle
from tidemap.client.encoding import MEASUREMENTS_PER_POST
from tidemap.importing.looks import LookColumns


@dataclass(slots=True)
class Tally:
    """posts: how many were sent; stored, known: measurements that are new, and that were stored by an earlier run.

    dropped: measurements that are older than the location keeps.
    """

    posts: int = 0
    stored: int = 0
    known: int = 0
    dropped: int = 0


def post_looks(location: LocationHandle, digest: str, looks: Iterable[LookColumns], tally: Tally) -> None:
    """Post looks of a file with this digest. Raises TidemapError; what was posted before stays, and is known again."""
    for number, look in enumerate(_batches(looks)):
        key = f"import-{digest[:24]}-{number}-{_digest(look)[:24]}"
        accepted = location.observe(look.time, look.state, look.cell, idempotency_key=key)
        tally.posts += 1
        tally.dropped += accepted.dropped
        if accepted.duplicate:
            tally.known += len(look)
        else:
            tally.stored += accepted.accepted


def _batches(looks: Iterable[LookColumns]) -> Iterator[LookColumns]:
    """Consecutive looks together, and long ones in parts, of at most MEASUREMENTS_PER_POST each."""
    held: list[LookColumns] = []
    for look in looks:
        for part in _parts(look):
            if held and sum(map(len, held)) + len(part) > MEASUREMENTS_PER_POST:
                yield _joined(held)
                held = []
            held.append(part)
    if held:
        yield _joined(held)


def _parts(look: LookColumns) -> Iterator[LookColumns]:
    for first in range(0, len(look), MEASUREMENTS_PER_POST):
        rows = slice(first, first + MEASUREMENTS_PER_POST)
        yield LookColumns(look.time[rows], look.state[rows], None if look.cell is None else look.cell[rows])


def _joined(looks: list[LookColumns]) -> LookColumns:
    cells = [each.cell for each in looks if each.cell is not None]
    return LookColumns(
        np.concatenate([each.time for each in looks]),
        np.concatenate([each.state for each in looks]),
        np.concatenate(cells) if cells else None,
    )


def _digest(look: LookColumns) -> str:
    digest = hashlib.sha256(look.time.tobytes() + look.state.tobytes())
    if look.cell is not None:
        digest.update(look.cell.tobytes())
    return digest.hexdigest()
