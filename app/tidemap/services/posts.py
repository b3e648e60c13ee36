"""Posts: what was sent, what became of it, and storing many of them in one transaction."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from tidemap.errors import DomainError, IdempotencyConflictError, LocationNotFoundError, UnauthorizedError
from tidemap.formats.registry import Body
from tidemap.services.anomalies import Anomaly
from tidemap.services.incidents import EventChange, store_events
from tidemap.services.keys import Claim, confirm
from tidemap.storage.records import AnomalyRecord, LocationRecord, ObservationRecord
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

    A duplicate, or one of nothing, has no number of its own.
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

    @property
    def anomalies(self) -> list[Anomaly]:
        """The events as they are now, with their ids."""
        return [change.event for change in self.changes]


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """A post that is parsed and judged: what is to be stored of it; `dropped` measurements are not."""

    location: LocationRecord
    post: Post
    record: ObservationRecord
    events: list[AnomalyRecord]
    dropped: int


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
        for entry in group:
            settled = claims[entry.post.claim] or _settled(entry, known)
            if settled is None:
                fresh.append(entry)
            else:
                outcome[entry] = settled
        first = work.observations.append(location_id, [entry.record for entry in fresh]) if fresh else 0
        if first is None:
            outcome |= {entry: LocationNotFoundError(entry.location.name) for entry in fresh}
        else:
            numbers |= {entry: number for number, entry in enumerate(fresh, first)}
    # After the last location, for what numbers events is locked, too; in the order in which they will be published.
    outcome |= _with_events(work, {entry: numbers[entry] for entry in entries if entry in numbers})
    return [outcome[entry] for entry in entries]


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


def _settled(entry: Entry, known: dict[str, bytes]) -> Outcome | None:
    """What becomes of a post whose key was used before, or that has nothing to store.

    None of a new one, whose key is known from now on.
    """
    key, digest = entry.record.idempotency_key, entry.record.body_hash
    who = entry.location.name, entry.record.source
    if key is not None and key in known:
        if known[key] != digest:
            return IdempotencyConflictError(key)
        return Observed(*who, 0, 0, 0, True, None, None, [], entry.location.revision)
    if not entry.record.measurements:
        return Observed(*who, 0, 0, entry.dropped, False, None, None, [], entry.location.revision)
    if key is not None and digest is not None:
        known[key] = digest
    return None


def _with_events(work: Work, numbers: Mapping[Entry, int]) -> Iterable[tuple[Entry, Outcome]]:
    """Store the events of posts that are stored under these numbers."""
    for entry, number in numbers.items():
        record, location = entry.record, entry.location
        changes = store_events(work, location, entry.events)
        what = (number, record.measurements, entry.dropped, False, record.first_time, record.last_time)
        yield entry, Observed(location.name, record.source, *what, changes, location.revision)
