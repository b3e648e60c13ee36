"""Incidents: what continues a stored event extends it, and what joins two of them makes them one.

Two events are one when both show a cell in the same state, at most the location's `gap_samples` lie between them and,
unless it says how long a gap may be, the cell was not read meanwhile. The order in which they come makes no
difference: see `link`. What was published as one stays one.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from tidemap.services.anomalies import Anomaly, anomaly_of
from tidemap.services.grouping import with_seen
from tidemap.services.mutes import is_muted
from tidemap.services.was_read import was_read
from tidemap.space.regions import Spans, link
from tidemap.storage.records import SEEN_FREE, SEEN_OCCUPIED, AnomalyRecord, LocationRecord
from tidemap.storage.work import Work

Done = Literal["new", "updated", "kept"]


@dataclass(frozen=True, slots=True, eq=False)
class EventChange:
    """An event as it is stored now, and whether that is `new`, `updated` or as it was before: `kept`.

    joined: the ids of younger events that are a part of it from now on.
    """

    event: Anomaly
    done: Done
    joined: tuple[int, ...] = ()

    @property
    def stored(self) -> bool:
        """Whether something is stored of it."""
        return self.done != "kept"

    @property
    def audible(self) -> bool:
        """Whether somebody is to hear of it."""
        return self.stored and not self.event.muted and self.event.snoozed_until is None


def store_events(
    work: Work, location: LocationRecord, events: Sequence[AnomalyRecord], now: float
) -> list[EventChange]:
    """Store events, now, with those they continue: of each that is stored then what was done.

    The location's row must be locked, so that nobody else extends the same event meanwhile.
    """
    if not events:
        return []
    groups, mutes = _with_stored(work, location, events), work.mutes.list()
    before = ended_before(location, now)
    united = [
        replace(event, muted=is_muted(mutes, location, event.start, event.stop), ended=event.stop < before)
        for event in map(_united, groups)
    ]
    changes = [_change(location, event, group) for event, group in zip(united, groups, strict=True)]
    appended = iter(work.anomalies.append([event for event in united if not event.id]))
    changed = iter(work.anomalies.change([each.event for each in changes if each.stored and each.event.id]))
    for change in changes:
        if change.joined:
            work.anomalies.absorb(location.id, change.joined, change.event.id)
    return [
        replace(each, event=anomaly_of(location, next(changed if each.event.id else appended))) if each.stored else each
        for each in changes
    ]


def ended_before(location: LocationRecord, now: float) -> float:
    """What stopped before this time is not continued by what is measured from now on.

    That is after the longest gap that an event outlasts. Of what is held nothing ends before it was judged.
    """
    held = location.missing == "hold" and location.revision
    judged = location.judged_to if held and location.judged_to is not None else now
    return min(judged, now) - (location.gap_samples + 1) * location.interval_s


def _with_stored(work: Work, location: LocationRecord, events: Sequence[AnomalyRecord]) -> list[list[AnomalyRecord]]:
    """What makes one event each of new ones, with the stored ones that they continue, or join; readable ones."""
    gap_s = (location.gap_samples + 0.5) * location.interval_s
    known: list[AnomalyRecord] | None = None
    groups = [[event] for event in events]
    while True:
        found = [event for group in groups for event in group]
        reach = min(event.start for event in found) - gap_s, max(event.stop for event in found) + gap_s
        stored = [event for event in work.anomalies.near(location.id, *reach) if event.damage is None]
        if known is not None and len(stored) == len(known):
            return groups
        known = stored
        groups = [group for group in _grouped(work, location, events, stored) if group[-1].id == 0]
        if not stored or location.n_cells == 1:
            return groups


def _grouped(
    work: Work, location: LocationRecord, events: Sequence[AnomalyRecord], stored: Sequence[AnomalyRecord]
) -> list[list[AnomalyRecord]]:
    """What makes one event each, in order of the start: stored ones first, the oldest first of all."""
    records = [*stored, *events]
    splits = partial(was_read, work, location) if location.event_gap_s is None else None
    number = link(_spans(location, records), location.gap_samples, splits)
    groups: dict[int, list[AnomalyRecord]] = {}
    for record, own in zip(records, number.tolist(), strict=True):
        groups.setdefault(own, []).append(record)
    return sorted(groups.values(), key=lambda group: min(record.start for record in group))


def _spans(location: LocationRecord, records: Sequence[AnomalyRecord]) -> Spans:
    """Events as groups of what they show: a cell that was both is in it twice."""
    label = np.repeat(np.arange(len(records)), [len(record.cells) for record in records])
    cell = np.concatenate([record.cells for record in records])
    seen = np.concatenate([record.bits for record in records])
    free, occupied = (np.flatnonzero(seen & bit) for bit in (SEEN_FREE, SEEN_OCCUPIED))
    rows, state = np.concatenate([free, occupied]), np.repeat(np.arange(2, dtype=np.uint8), [len(free), len(occupied)])
    first = location.base.sample([record.start for record in records])
    last = location.base.sample([record.stop for record in records]) - 1
    return Spans(label[rows], cell[rows], state, first, last)


def _change(location: LocationRecord, united: AnomalyRecord, group: Sequence[AnomalyRecord]) -> EventChange:
    """What becomes of the oldest of a group, which is new where none of them is stored.

    What nobody has heard of, as it was muted, is new to those who hear of it now.
    """
    if not united.id:
        return EventChange(anomaly_of(location, united), "new")
    oldest, *others = [record for record in group if record.id]
    if not others and _alike(united, oldest):
        return EventChange(anomaly_of(location, oldest), "kept")
    done: Done = "new" if all(record.muted for record in (oldest, *others)) else "updated"
    return EventChange(anomaly_of(location, united), done, tuple(record.id for record in others))


def _alike(one: AnomalyRecord, other: AnomalyRecord) -> bool:
    """Whether there is nothing new in what is shown of an event but how it was judged."""
    same = (one.start, one.stop, one.surprise) == (other.start, other.stop, other.surprise)
    return same and np.array_equal(one.cells, other.cells) and np.array_equal(one.bits, other.bits)


def _united(group: Sequence[AnomalyRecord]) -> AnomalyRecord:
    """Events as one, under the number of the first; judged as the latest was."""
    if len(group) == 1:
        return group[0]
    latest = max(reversed(group), key=lambda record: record.revision)
    seen_by = next((record for record in group if record.acknowledged_by is not None), group[0])
    snoozed = max(group, key=lambda record: record.snoozed_until or 0.0)
    marks = sum(record.marks for record in group)
    cells, row = np.unique(np.concatenate([record.cells for record in group]), return_inverse=True)
    seen = np.zeros(len(cells), np.uint8)
    np.bitwise_or.at(seen, row, np.concatenate([record.bits for record in group]))
    united = replace(
        group[0],
        start=min(record.start for record in group),
        stop=max(record.stop for record in group),
        cells=cells,
        probability=sum(record.probability * record.marks for record in group) / marks,
        surprise=max(record.surprise for record in group),
        confidence=latest.confidence,
        rule=latest.rule,
        revision=latest.revision,
        marks=marks,
        acknowledged_by=seen_by.acknowledged_by,
        acknowledged_at=seen_by.acknowledged_at,
        note=seen_by.note,
        snoozed_by=snoozed.snoozed_by,
        snoozed_until=snoozed.snoozed_until,
    )
    return with_seen(united, seen)


def published(changes: Sequence[EventChange]) -> Iterator[EventChange]:
    """Those that somebody is to hear of."""
    return (change for change in changes if change.audible)
