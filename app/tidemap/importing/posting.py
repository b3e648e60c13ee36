"""Posting: snapshots in large posts, whose keys say from which file and where in it they are."""

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from tidemap.client import LocationHandle
from tidemap.client.encoding import MEASUREMENTS_PER_POST
from tidemap.importing.snapshots import SnapshotColumns


@dataclass(slots=True)
class Tally:
    """posts: how many were sent; stored, known: measurements that are new, and that were stored by an earlier run.

    dropped: measurements that are older than the location keeps.
    """

    posts: int = 0
    stored: int = 0
    known: int = 0
    dropped: int = 0


def post_snapshots(location: LocationHandle, digest: str, snapshots: Iterable[SnapshotColumns], tally: Tally) -> None:
    """Post snapshots of a file with this digest. Raises TidemapError; what was posted before that stays."""
    for number, snapshot in enumerate(_batches(snapshots)):
        key = f"import-{digest[:24]}-{number}-{_digest(snapshot)[:24]}"
        accepted = location.observe(snapshot.time, snapshot.state, snapshot.cell, idempotency_key=key)
        tally.posts += 1
        tally.dropped += accepted.dropped
        if accepted.duplicate:
            tally.known += len(snapshot)
        else:
            tally.stored += accepted.accepted


def _batches(snapshots: Iterable[SnapshotColumns]) -> Iterator[SnapshotColumns]:
    """Consecutive snapshots together, and long ones in parts, of at most MEASUREMENTS_PER_POST each."""
    held: list[SnapshotColumns] = []
    for snapshot in snapshots:
        for part in _parts(snapshot):
            if held and sum(map(len, held)) + len(part) > MEASUREMENTS_PER_POST:
                yield _joined(held)
                held = []
            held.append(part)
    if held:
        yield _joined(held)


def _parts(snapshot: SnapshotColumns) -> Iterator[SnapshotColumns]:
    for first in range(0, len(snapshot), MEASUREMENTS_PER_POST):
        rows = slice(first, first + MEASUREMENTS_PER_POST)
        yield SnapshotColumns(
            snapshot.time[rows], snapshot.state[rows], None if snapshot.cell is None else snapshot.cell[rows]
        )


def _joined(snapshots: list[SnapshotColumns]) -> SnapshotColumns:
    cells = [each.cell for each in snapshots if each.cell is not None]
    return SnapshotColumns(
        np.concatenate([each.time for each in snapshots]),
        np.concatenate([each.state for each in snapshots]),
        np.concatenate(cells) if cells else None,
    )


def _digest(snapshot: SnapshotColumns) -> str:
    digest = hashlib.sha256(snapshot.time.tobytes() + snapshot.state.tobytes())
    if snapshot.cell is not None:
        digest.update(snapshot.cell.tobytes())
    return digest.hexdigest()
