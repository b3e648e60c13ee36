"""Posts: what was sent, what became of it, and storing many of them in one transaction."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from tidemap.errors import DomainError, IdempotencyConflictError, LocationNotFoundError, UnauthorizedError
from tidemap.formats.registry import Body
from tidemap.services.anomalies import Anomaly
from tidemap.services.incidents import EventChange, store_events
from tidemap.services.keys import Claim, confirm
from tidemap.storage.records import AnomalyRecord, LocationRecord, ObservationRecord, ScanRecord
from tidemap.storage.work import Work


@dataclass(frozen=True, slots=True)
class Post:
    """A body with what its sender says about it, and who that is where it has not been made sure of yet."""

    body: Body
    source: str | None = None
    idempotency_key: str | None = None
    claim: Claim | None = None


@dataclass(frozen=True, slots=True)
class Observed:
    """What became of a post, and of the events that it began or extended.

    A duplicate, or one of nothing, has no number of its own. scan: of a scan what is stored of it, of a duplicate the
    first one's; None where that is not stored any more.
    """

    location: str
    source: str | None
    number: int
    accepted: int
    dropped: int
    duplicate: bool
    first_time: float | None
    last_time: float | None
    changes: list[EventChange]
    revision: int
    scan: ScanRecord | None = None

    @property
    def anomalies(self) -> list[Anomaly]:
        """The events as they are now, with their ids."""
        return [change.event for change in self.changes]


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """A post that is parsed and judged: what is to be stored of it; `dropped` measurements are not.

    A scan that is quarantined has no measurements.
    """

    location: LocationRecord
    post: Post
    record: ObservationRecord
    events: list[AnomalyRecord]
    dropped: int
    scan: ScanRecord | None = None


Outcome = Observed | DomainError


def store_all(work: Work, entries: Sequence[Entry]) -> list[Outcome]:
    """Store what has not been stored yet of some posts, in their order; of each what became of it.

    Of one whose sender is not known any more, whose key was used for another body or whose location is gone, it is
    the error, and nothing is stored. Locations are locked in the order of their ids, so that no two processes wait
    for each other.
    """
    outcome: dict[Entry, Outcome] = {}
    numbers: dict[Entry, int] = {}
    claims = {claim: _confirmed(work, claim) for claim in {entry.post.claim for entry in entries}}
    for location_id, group in sorted(_by_location(entries).items()):
        fresh = []
        known = work.observations.digests(
            location_id, [key for entry in group if (key := entry.record.idempotency_key)]
        )
        scans = _known_scans(work, location_id, group)
        known |= {key: scan.body_hash for key, scan in scans.items() if scan.body_hash is not None}
        for entry in group:
            settled = claims[entry.post.claim] or _settled(entry, known, scans)
            if settled is None:
                fresh.append(entry)
            else:
                outcome[entry] = settled
        stored = _append(work, location_id, fresh) if fresh else {}
        if stored is None:
            outcome |= {entry: LocationNotFoundError(entry.location.name) for entry in fresh}
        else:
            numbers |= stored
    # After the last location, for what numbers events is locked, too; in the order in which they will be published.
    outcome |= _with_events(work, {entry: numbers[entry] for entry in entries if entry in numbers})
    return [outcome[entry] for entry in entries]


def _known_scans(work: Work, location_id: int, entries: Sequence[Entry]) -> dict[str, ScanRecord]:
    """The scans that were posted under the keys of scans among these, by key."""
    keys = [key for entry in entries if entry.scan is not None and (key := entry.record.idempotency_key)]
    return work.scans.by_key(location_id, keys) if keys else {}


def _append(work: Work, location_id: int, entries: Sequence[Entry]) -> dict[Entry, int] | None:
    """Append what was measured to the log; the number of each, 0 of a scan in quarantine.

    None where the location is gone.
    """
    measured = [entry for entry in entries if entry.record.measurements]
    numbers = dict.fromkeys(entries, 0)
    if measured:
        first = work.observations.append(location_id, [entry.record for entry in measured])
        if first is None:
            return None
        return numbers | {entry: number for number, entry in enumerate(measured, first)}
    return numbers if work.locations.exists(location_id) else None


def _by_location(entries: Sequence[Entry]) -> dict[int, list[Entry]]:
    groups = defaultdict(list)
    for entry in entries:
        groups[entry.location.id].append(entry)
    return groups


def _confirmed(work: Work, claim: Claim | None) -> UnauthorizedError | None:
    """What is wrong with a claim."""
    try:
        if claim is not None:
            confirm(work, claim)
    except UnauthorizedError as error:
        return error
    return None


def _settled(entry: Entry, known: dict[str, bytes], scans: Mapping[str, ScanRecord]) -> Outcome | None:
    """What becomes of a post whose key was used before, or that has nothing to store.

    None of a new one, whose key is known from now on.
    """
    key, digest = entry.record.idempotency_key, entry.record.body_hash
    who = entry.location.name, entry.record.source
    if key is not None and key in known:
        if known[key] != digest:
            return IdempotencyConflictError(key)
        return Observed(*who, 0, 0, 0, True, None, None, [], entry.location.revision, scans.get(key))
    if not entry.record.measurements and entry.scan is None:
        return Observed(*who, 0, 0, entry.dropped, False, None, None, [], entry.location.revision)
    if key is not None and digest is not None:
        known[key] = digest
    return None


def _with_events(work: Work, numbers: Mapping[Entry, int]) -> Iterable[tuple[Entry, Outcome]]:
    """Store the events and the scans of posts that are stored under these numbers."""
    scans = iter(
        work.scans.append(
            [
                replace(entry.scan, observation=number or None)
                for entry, number in numbers.items()
                if entry.scan is not None
            ]
        )
    )
    for entry, number in numbers.items():
        record, location = entry.record, entry.location
        changes = store_events(work, location, entry.events, record.received_at)
        first, last = (record.first_time, record.last_time) if record.measurements else (None, None)
        what = (number, record.measurements, entry.dropped, False, first, last)
        scan = None if entry.scan is None else next(scans)
        yield entry, Observed(location.name, record.source, *what, changes, location.revision, scan)
