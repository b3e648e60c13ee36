"""Silence: a location that usually speaks, by its own rhythm, and does not, is an event until its next post.

Posts count when they come, by the server's clock: whatever a robot's clock says, it has spoken. Silence counts from
when a server listens: what happened while none did nobody knows.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError, LocationNotFoundError
from tidemap.services.anomalies import anomaly_of
from tidemap.services.context import Context
from tidemap.services.incidents import EventChange
from tidemap.services.messages import publish_events
from tidemap.services.mutes import is_muted
from tidemap.spectral.civil import week_seconds
from tidemap.spectral.rhythm import MIN_EXPECTED, WEEKS, Rhythm
from tidemap.storage.blobs import pack_numbers, unpack_numbers
from tidemap.storage.records import AnomalyRecord, LocationRecord, RhythmRecord
from tidemap.storage.repositories.anomalies import SILENCE
from tidemap.storage.work import Work

INTERVAL_S = 300.0
"""Intervals in which something is heard or not."""
MAX_INTERVALS = int(WEEKS * 7 * 86_400 / INTERVAL_S)
LISTENED_EVERY_S = 60.0
"""How often it is stored that a server listens."""
MAX_UNHEARD_S = 180.0
"""After so long without that nobody knows whether anybody has spoken: the count begins anew."""
STORED_EVERY_S = 600.0
"""How often it is stored when a location was heard, while nothing becomes of it; the log has it until then."""


@dataclass(slots=True, eq=False)
class _Heard:
    """When a location was heard: `interval` (n,) numbers ascending; the others as in RhythmRecord.

    stored_at: when that was stored. rhythm: as it was with the last of these intervals. judged: in which interval last.
    """

    interval: NDArray[np.int64]
    through: int
    last: float | None
    silence: int | None
    stored_at: float
    rhythm: tuple[int, Rhythm] | None = None
    judged: int = 0

    def record(self, location_id: int) -> RhythmRecord:
        return RhythmRecord(
            location_id=location_id,
            through=self.through,
            heard=pack_numbers(self.interval),
            last_heard=self.last,
            silence=self.silence,
        )


@dataclass(slots=True)
class Silences:
    """What is known of all locations, in one term of a leader."""

    _heard: dict[int, _Heard] | None = None
    _since: float = 0.0
    _until: float = field(default=-np.inf)

    def watch(self, ctx: Context, check: Callable[[], None] = lambda: None) -> None:
        """Take note of what was posted, and begin and end events. `check` as of `judge_standing`."""
        self._listen(ctx)
        with ctx.store.read() as work:
            locations = work.locations.list()
            if self._heard is None:
                self._heard = {id_: _loaded(record) for id_, record in work.rhythms.all().items()}
        known, nothing = self._heard, np.zeros(0, np.int64)
        self._heard = {each.id: known.get(each.id) or _Heard(nothing, 0, None, None, ctx.clock()) for each in locations}
        for location in locations:
            check()
            # One may be deleted meanwhile.
            with suppress(LocationNotFoundError):
                self._attend(ctx, location, self._heard[location.id])

    def _listen(self, ctx: Context) -> None:
        """Take note that a server listens, since when it has."""
        now = ctx.clock()
        if 0 <= now - self._until < LISTENED_EVERY_S:
            return
        with ctx.store.read() as work:
            known = work.rhythms.listening()
        without_break = known is not None and 0 <= now - known[1] <= MAX_UNHEARD_S
        self._since, self._until = known[0] if known is not None and without_break else now, now
        ctx.store.write(lambda work: work.rhythms.listen(self._since, now))

    def _attend(self, ctx: Context, location: LocationRecord, heard: _Heard) -> None:
        came = _take_in(ctx, location, heard) if location.observation_seq > heard.through else None
        now = ctx.clock()
        if came is not None and heard.silence is not None:
            _end(ctx, location, heard, came)
        elif heard.silence is not None:
            _hear(ctx, location, heard)
        elif (expected := self._unusual(ctx, location, heard)) is not None:
            _begin(ctx, location, heard, expected)
        elif came is not None and not 0 <= now - heard.stored_at < STORED_EVERY_S:
            _store(ctx, location, heard)

    def _unusual(self, ctx: Context, location: LocationRecord, heard: _Heard) -> tuple[float, float] | None:
        """How much was expected since a location was heard last, and how much is usual; None where it is not more."""
        now = int(ctx.clock() // INTERVAL_S)
        if heard.last is None or heard.judged == now:
            return None
        heard.judged = now
        silence = _silence(heard.last, self._since, ctx.clock())
        if len(silence) < MIN_EXPECTED:
            return None
        last = int(heard.interval[-1])
        if heard.rhythm is None or heard.rhythm[0] != last:
            heard.rhythm = last, _rhythm(location, heard.interval)
        rhythm = heard.rhythm[1]
        expected = rhythm.silence(_civil(location, silence))
        return (expected, rhythm.longest) if expected > rhythm.longest else None


@dataclass(frozen=True, slots=True, eq=False)
class Usual:
    """The rhythm of a location as it was stored last, and since when a server has listened."""

    location: LocationRecord
    rhythm: Rhythm
    since: float

    def is_silent(self, last: float, now: float, share: float) -> bool:
        """Whether one that is heard in a share of the intervals has not been for longer than is usual, since `last`."""
        silence = _silence(last, self.since, now)
        return share * self.rhythm.silence(_civil(self.location, silence)) > self.rhythm.longest


def usual(work: Work, location: LocationRecord) -> Usual | None:
    """None where nothing was heard yet, or what is stored of it cannot be read."""
    record, listening = work.rhythms.find(location.id), work.rhythms.listening()
    if record is None or listening is None:
        return None
    interval = _loaded(record).interval
    return Usual(location, _rhythm(location, interval), listening[0]) if len(interval) else None


def _silence(last: float, since: float, now: float) -> NDArray[np.int64]:
    """The numbers of the intervals that have passed since something was heard last while a server listened."""
    first = int(max(last, since) // INTERVAL_S) + 1
    return np.arange(first, min(int(now // INTERVAL_S), first + MAX_INTERVALS))


def _loaded(record: RhythmRecord) -> _Heard:
    """What is stored of a location; where that cannot be read, what is left of it in the log."""
    try:
        interval = unpack_numbers(record.heard, f"the rhythm of location {record.location_id}")
    except CorruptChunkError:
        return _Heard(np.zeros(0, np.int64), 0, None, record.silence, 0.0)
    return _Heard(interval, record.through, record.last_heard, record.silence, 0.0)


def _take_in(ctx: Context, location: LocationRecord, heard: _Heard) -> float | None:
    """Take note of what was posted since; when the first of it came, None where only a wrong clock has counted it."""
    now = ctx.clock()
    with ctx.store.read() as work:
        times = np.fromiter(work.rhythms.received(location, heard.through), np.float64)
    heard.through = location.observation_seq
    times = times[times <= now + INTERVAL_S]
    if not len(times):
        return None
    intervals = np.union1d(heard.interval, np.floor(times / INTERVAL_S).astype(np.int64))
    intervals = intervals[intervals <= now // INTERVAL_S + 1]
    heard.interval = intervals[intervals > intervals[-1] - MAX_INTERVALS]
    heard.last = float(times.max() if heard.last is None or heard.last > now else max(times.max(), heard.last))
    return float(times[0])


def _civil(location: LocationRecord, interval: NDArray[np.int64]) -> NDArray[np.float64]:
    return week_seconds(interval.astype(np.float64) * INTERVAL_S, location.time_zone, location.calendar)


def _rhythm(location: LocationRecord, interval: NDArray[np.int64]) -> Rhythm:
    whole = np.arange(interval[0], interval[-1] + 1)
    return Rhythm.of(np.isin(whole, interval), _civil(location, whole))


def _begin(ctx: Context, location: LocationRecord, heard: _Heard, found: tuple[float, float]) -> None:
    """Store that a location is silent, unless it has spoken by now."""
    now = ctx.clock()
    p, confidence = (float(-np.expm1(-each)) for each in found)

    def begin(work: Work) -> list[EventChange]:
        latest = work.locations.lock(location.id)
        if latest.observation_seq > heard.through:
            return []
        event = AnomalyRecord(
            location.id, 0, heard.last or now, now, np.zeros(0, np.int64), 0, p, p, confidence, SILENCE, latest.revision
        )
        (event,) = work.anomalies.append([replace(event, muted=is_muted(work.mutes.list(), latest, now, now))])
        work.rhythms.put(replace(heard.record(location.id), silence=event.id))
        return [EventChange(anomaly_of(latest, event), "new")]

    for change in ctx.store.write(begin, lambda changes: publish_events(ctx, changes)):
        heard.silence, heard.stored_at = change.event.id, now


def _end(ctx: Context, location: LocationRecord, heard: _Heard, came: float) -> None:
    """Store that a location has spoken again, at a time."""

    def end(work: Work) -> list[EventChange]:
        work.rhythms.put(replace(heard.record(location.id), silence=None))
        event = work.anomalies.get(heard.silence or 0)
        ended = replace(event, stop=max(came, event.start), ended=True)
        return [EventChange(anomaly_of(location, each), "updated") for each in work.anomalies.mark([ended])]

    ctx.store.write(end, lambda changes: publish_events(ctx, changes))
    heard.silence, heard.stored_at = None, ctx.clock()


def _hear(ctx: Context, location: LocationRecord, heard: _Heard) -> None:
    """Publish a silence that goes on after the time in which it was muted."""
    now = ctx.clock()

    def still(work: Work) -> list[EventChange]:
        event = work.anomalies.get(heard.silence or 0)
        if not event.muted or is_muted(work.mutes.list(), location, now, now):
            return []
        marked = work.anomalies.mark([replace(event, muted=False)])
        return [EventChange(anomaly_of(location, each), "new") for each in marked]

    with ctx.store.read() as work:
        muted = work.anomalies.get(heard.silence or 0).muted
    if muted:
        ctx.store.write(still, lambda changes: publish_events(ctx, changes))


def _store(ctx: Context, location: LocationRecord, heard: _Heard) -> None:
    heard.stored_at = ctx.clock()
    ctx.store.write(lambda work: work.rhythms.put(heard.record(location.id)))
