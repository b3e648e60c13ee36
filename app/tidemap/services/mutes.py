"""Mutes: times in which nobody is to hear of the events of some locations; those are stored all the same."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

from tidemap.errors import InvalidInputError, TooManyMutesError, refuse_reversed
from tidemap.events.messages import Attention, EventMessage
from tidemap.scope import EVERYWHERE, Scope
from tidemap.services.context import Context
from tidemap.storage.records import LocationRecord, MuteRecord
from tidemap.storage.work import Work

MAX_MUTES = 1000
EVERY = ("*",)
"""The pattern of all locations."""
WEEK_S = 7 * 86400.0


@dataclass(frozen=True, slots=True)
class NewMute:
    """Events of a scope in [start, stop) (Unix s) are muted; `weekly` those of every later week, until `until`, too.

    A week later is at the same time of the clock of each location's zone.
    """

    scope: Scope
    start: float
    stop: float
    weekly: bool = False
    until: float | None = None
    note: str = ""

    def __post_init__(self) -> None:
        refuse_reversed(self.start, self.stop)
        if self.weekly and self.stop - self.start > WEEK_S:
            raise InvalidInputError.at("stop", "a time that comes again every week lasts a week at most")
        if self.until is not None and not self.weekly:
            raise InvalidInputError.at("until", "only a `weekly` mute has an end of its own; `stop` ends this one")
        if self.until is not None and self.until < self.stop:
            raise InvalidInputError.at("until", "this lies before the end of the first time, `stop`")


def create_mute(ctx: Context, new: NewMute, by: str) -> MuteRecord:
    """Raises TooManyMutesError."""
    values = {
        "locations": new.scope.dumped(),
        **{name: getattr(new, name) for name in ("start", "stop", "weekly", "until", "note")},
        "created_by": by,
        "created_at": ctx.clock(),
    }

    def create(work: Work) -> MuteRecord:
        if work.mutes.count() >= MAX_MUTES:
            raise TooManyMutesError(MAX_MUTES)
        return work.mutes.create(values)

    return ctx.store.write(create, lambda made: _publish(ctx, made, "muted"))


def list_mutes(ctx: Context, scope: Scope = EVERYWHERE, after: int = 0) -> list[MuteRecord]:
    """Those after an id, in order of creation, that may concern locations of a scope."""
    with ctx.store.read() as work:
        return [each for each in work.mutes.list(after) if scope.touches(each.scope)]


def get_mute(ctx: Context, mute_id: int) -> MuteRecord:
    """Raises MuteNotFoundError."""
    with ctx.store.read() as work:
        return work.mutes.get(mute_id)


def delete_mute(ctx: Context, mute_id: int) -> None:
    """Events that it muted stay so. Raises MuteNotFoundError."""

    def delete(work: Work) -> MuteRecord:
        gone = work.mutes.get(mute_id)
        work.mutes.delete(mute_id)
        return gone

    ctx.store.write(delete, lambda gone: _publish(ctx, gone, "unmuted"))


def _publish(ctx: Context, mute: MuteRecord, change: Attention) -> None:
    """Publish what has become of a mute, once for each pattern of its locations."""
    for pattern in EVERY if mute.scope.patterns is None else mute.scope.patterns:
        ctx.bus.publish(EventMessage("attention", pattern, mute.id, ctx.clock(), {"change": change}))


def is_muted(mutes: Sequence[MuteRecord], location: LocationRecord, start: float, stop: float) -> bool:
    """Whether all of a time [start, stop] of a location lies in one that is muted."""
    mine = (each for each in mutes if each.scope.holds(location.name))
    return any(_covers(each, ZoneInfo(location.time_zone), start, stop) for each in mine)


def _covers(mute: MuteRecord, zone: ZoneInfo, start: float, stop: float) -> bool:
    if not mute.weekly:
        return mute.start <= start and stop <= mute.stop
    if start < mute.start or (mute.until is not None and stop > mute.until):
        return False
    begin, end = (datetime.fromtimestamp(each, zone) for each in (mute.start, mute.stop))
    # A change of the clock moves it by an hour: the week before or after may be meant.
    near = int((start - mute.start) // WEEK_S)
    for week in range(max(0, near - 1), near + 2):
        later = timedelta(weeks=week)
        if (begin + later).timestamp() <= start and stop <= (end + later).timestamp():
            return True
    return False
