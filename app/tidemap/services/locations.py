"""Making, changing, listing and deleting locations."""

from dataclasses import dataclass, fields
from typing import Any

from tidemap.errors import InvalidInputError
from tidemap.schemas.locations import LocationForm, LocationPatch
from tidemap.schemas.scope import EVERYWHERE, Scope
from tidemap.services.context import Context
from tidemap.storage.records import LocationRecord, RevisionRecord
from tidemap.storage.work import Work


@dataclass(frozen=True)
class LocationSummary(LocationRecord):
    """A location with what is known of it: when its revision was made, how accurate that is, and open anomalies."""

    updated_at: float | None
    accuracy: float | None
    open_anomalies: int


def create_location(ctx: Context, form: LocationForm) -> LocationSummary:
    """Raises LocationExistsError, InvalidInputError."""
    n_cells = form.grid.n_cells if form.grid else 1
    if n_cells > ctx.settings.max_cells:
        raise InvalidInputError.at(
            "grid.shape",
            f"{n_cells} cells are more than this server's {ctx.settings.max_cells}; use several locations",
        )
    values = form.model_dump(exclude={"grid", "retention", "order"})
    values |= {
        "order": None if form.order == "auto" else form.order,
        "retention_s": form.retention,
        "grid": form.grid.model_dump_json() if form.grid else None,
        "created_at": ctx.clock(),
    }
    record = ctx.store.write(lambda work: work.locations.create(values))
    return _summary(record, None, 0)


def change_location(ctx: Context, name: str, form: LocationPatch) -> LocationSummary:
    """Change what the form names. Raises LocationNotFoundError, LocationExistsError, InvalidInputError."""
    values: dict[str, Any] = form.model_dump(exclude_unset=True)
    for field in ("name", "time_zone", "estimator", "order", "confidence", "missing", "combine", "min_cells"):
        if field in values and values[field] is None:
            raise InvalidInputError.at(field, "null is no value here; leave the field out to keep it as it is")
    if values.get("order") == "auto":
        values["order"] = None
    if "retention" in values:
        values["retention_s"] = values.pop("retention")

    def change(work: Work) -> None:
        _refuse_recombining(work.locations.get(name), values.get("combine"))
        record = work.locations.change(name, values)
        if record.missing == "hold" and record.hold_s is None:
            raise InvalidInputError.at("hold_s", "`missing` = 'hold' needs the seconds a state stands at most")

    ctx.store.write(change, lambda _: ctx.caches.locations.forget())
    return get_location(ctx, values.get("name", name))


def _refuse_recombining(record: LocationRecord, combine: str | None) -> None:
    """What was combined cannot be taken apart again. Raises InvalidInputError."""
    if combine not in (None, record.combine) and record.first_time is not None:
        raise InvalidInputError.at(
            "combine",
            f"the observations of this location are combined by {record.combine!r}, which cannot be taken apart again; "
            "make a new location, or delete its observations first",
        )


def delete_location(ctx: Context, name: str) -> None:
    """With all that belongs to it. Raises LocationNotFoundError."""
    ctx.damage.forget(
        ctx.store.write(lambda work: work.locations.delete(name), lambda _: ctx.caches.locations.forget())
    )


def find_location(ctx: Context, name: str) -> LocationRecord:
    """Its record. Raises LocationNotFoundError."""
    with ctx.store.read() as work:
        return work.locations.get(name)


def get_location(ctx: Context, name: str) -> LocationSummary:
    """With what is known of it. Raises LocationNotFoundError."""
    with ctx.store.read() as work:
        record = work.locations.get(name)
        revision = work.spectra.get(record.id, record.revision)
        return _summary(record, revision, work.locations.open_anomalies().get(record.id, 0))


def list_locations(
    ctx: Context, after: str | None = None, limit: int | None = None, scope: Scope = EVERYWHERE
) -> list[LocationSummary]:
    """Those in scope, in order of their names."""
    with ctx.store.read() as work:
        revisions, events = work.spectra.current(), work.locations.open_anomalies()
        records = work.locations.list(after, limit, scope)
    return [_summary(record, revisions.get(record.id), events.get(record.id, 0)) for record in records]


def _summary(record: LocationRecord, revision: RevisionRecord | None, open_anomalies: int) -> LocationSummary:
    return LocationSummary(
        **{each.name: getattr(record, each.name) for each in fields(record)},
        updated_at=revision.updated_at if revision else None,
        accuracy=revision.accuracy if revision else None,
        open_anomalies=open_anomalies,
    )
