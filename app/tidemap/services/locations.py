"""Making, changing, listing and deleting locations."""

from dataclasses import dataclass, fields
from typing import Literal, TypedDict

from tidemap.errors import InvalidInputError
from tidemap.events.messages import EventMessage
from tidemap.scope import EVERYWHERE, Scope
from tidemap.services.context import Context
from tidemap.space.grid import GridGeometry
from tidemap.space.pose import FramedPosition
from tidemap.spectral.civil import knows_calendar
from tidemap.storage.records import LocationRecord, RevisionRecord, SensorSetting, text_of
from tidemap.storage.work import Work


@dataclass(frozen=True, slots=True, kw_only=True)
class NewLocation:
    """What a location is made with, named as in its record. `order` None means that `auto` chooses it."""

    name: str
    interval_s: float
    kind: str = "state"
    time_zone: str = "UTC"
    epoch: float = 0.0
    grid: GridGeometry | None = None
    estimator: str = "auto"
    order: int | None = None
    confidence: float = 0.9
    missing: str = "mask"
    hold_s: float | None = None
    combine: str = "latest"
    retention_s: float | None = None
    min_cells: int = 1
    event_gap_s: float | None = None
    calendar: str | None = None
    pose: FramedPosition | None = None
    sensor: SensorSetting | None = None


class LocationChanges(TypedDict, total=False):
    """What is to be changed of a location, named as in its record; what is left out stays."""

    name: str
    time_zone: str
    estimator: str
    order: int | None
    confidence: float
    missing: str
    hold_s: float | None
    combine: str
    retention_s: float | None
    min_cells: int
    event_gap_s: float | None
    calendar: str | None
    pose: FramedPosition | None
    sensor: SensorSetting | None


@dataclass(frozen=True)
class LocationSummary(LocationRecord):
    """A location with what is known of it: when its revision was made, how accurate that is, and open anomalies."""

    updated_at: float | None
    accuracy: float | None
    open_anomalies: int


def create_location(ctx: Context, new: NewLocation) -> LocationSummary:
    """Raises LocationExistsError, InvalidInputError."""
    n_cells = new.grid.n_cells if new.grid else 1
    if n_cells > ctx.settings.max_cells:
        raise InvalidInputError.at(
            "grid.shape",
            f"{n_cells} cells are more than this server's {ctx.settings.max_cells}; use several locations",
        )
    _check_calendar(new.calendar)
    values = {each.name: getattr(new, each.name) for each in fields(new)}
    values |= {"grid": text_of(new.grid), "pose": text_of(new.pose), "sensor": text_of(new.sensor)}
    values["created_at"] = ctx.clock()
    record = ctx.store.write(lambda work: work.locations.create(values))
    _publish(ctx, record.name, record.id, "created")
    return summary(record, None, 0)


def change_location(ctx: Context, name: str, changes: LocationChanges) -> LocationSummary:
    """Raises LocationNotFoundError, LocationExistsError, InvalidInputError."""
    _check_calendar(changes.get("calendar"))
    values: dict[str, object] = {**changes}
    if "pose" in changes:
        values["pose"] = text_of(changes["pose"])
    if "sensor" in changes:
        values["sensor"] = text_of(changes["sensor"])

    def change(work: Work) -> LocationRecord:
        _refuse_recombining(work.locations.get(name), changes.get("combine"))
        record = work.locations.change(name, values)
        if record.missing == "hold" and record.hold_s is None:
            raise InvalidInputError.at("hold_s", "`missing` = 'hold' needs the seconds a state stands at most")
        return record

    changed = ctx.store.write(change, lambda _: ctx.caches.locations.forget())
    _publish(ctx, name, changed.id, "changed", changed.name)
    return get_location(ctx, changes.get("name", name))


def _refuse_recombining(record: LocationRecord, combine: str | None) -> None:
    """What was combined cannot be taken apart again. Raises InvalidInputError."""
    if combine not in (None, record.combine) and record.first_time is not None:
        raise InvalidInputError.at(
            "combine",
            f"the observations of this location are combined by {record.combine!r}, which cannot be taken apart again; "
            "make a new location, or delete its observations first",
        )


def _check_calendar(code: str | None) -> None:
    if code is not None and not knows_calendar(code):
        raise InvalidInputError.at(
            "calendar", f"there are no public holidays of {code!r} here; use an ISO 3166 code such as GB or DE-BY"
        )


def delete_location(ctx: Context, name: str) -> None:
    """With all that belongs to it. Raises LocationNotFoundError."""
    gone = ctx.store.write(lambda work: work.locations.delete(name), lambda _: ctx.caches.locations.forget())
    ctx.damage.forget(gone)
    _publish(ctx, name, gone, "deleted")


def _publish(
    ctx: Context,
    name: str,
    location_id: int,
    change: Literal["created", "changed", "deleted"],
    called: str | None = None,
) -> None:
    """Publish what has become of a location; `called` is its name from now on, where it still is."""
    ctx.bus.publish(EventMessage("location", name, location_id, ctx.clock(), {"change": change, "called": called}))


def find_location(ctx: Context, name: str) -> LocationRecord:
    """Its record. Raises LocationNotFoundError."""
    with ctx.store.read() as work:
        return work.locations.get(name)


def get_location(ctx: Context, name: str) -> LocationSummary:
    """With what is known of it. Raises LocationNotFoundError."""
    with ctx.store.read() as work:
        record = work.locations.get(name)
        revision = work.spectra.get(record.id, record.revision)
        return summary(record, revision, work.locations.open_anomalies_of(record.id))


def list_locations(
    ctx: Context, after: str | None = None, limit: int | None = None, scope: Scope = EVERYWHERE
) -> list[LocationSummary]:
    """Those in scope, in order of their names."""
    with ctx.store.read() as work:
        revisions, events = work.spectra.current(), work.locations.open_anomalies()
        records = work.locations.list(after, limit, scope)
    return [summary(record, revisions.get(record.id), events.get(record.id, 0)) for record in records]


def summary(record: LocationRecord, revision: RevisionRecord | None, open_anomalies: int) -> LocationSummary:
    """A location with what is known of it."""
    return LocationSummary(
        **{each.name: getattr(record, each.name) for each in fields(record)},
        updated_at=revision.updated_at if revision else None,
        accuracy=revision.accuracy if revision else None,
        open_anomalies=open_anomalies,
    )
