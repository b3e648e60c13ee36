"""Operations on the server as a whole: locations, anomalies, jobs and keys."""

from collections.abc import Mapping, Sequence
from typing import Any, Generic, Literal, TypeAlias, TypeVar

from tidemap.client.operation import Resource, operation, paged
from tidemap.client.plans import F, Listing, Plan, Request, ask
from tidemap.client.requests import post, present
from tidemap.client.times import TimeLike, unix
from tidemap.schemas.anomalies import Event, EventDetail
from tidemap.schemas.common import Page
from tidemap.schemas.jobs import Job
from tidemap.schemas.keys import Key, NewKey, Role
from tidemap.schemas.locations import (
    Combine,
    EstimatorChoice,
    Grid,
    Kind,
    Location,
    Missing,
    OrderChoice,
    Position,
    SensorRates,
)
from tidemap.schemas.mutes import Mute

Handle = TypeVar("Handle")
Items: TypeAlias = list[F]


class AnomalyOperations(Resource):
    """What the server as a whole and each location have."""

    @paged
    def anomalies(
        self,
        *,
        after: str | int | None = None,
        start: TimeLike | None = None,
        stop: TimeLike | None = None,
        min_surprise: float | None = None,
        acknowledged: bool | None = None,
        muted: bool | None = None,
        limit: int | None = None,
    ) -> Listing[Event]:
        """Stored anomalies, oldest first, over all pages of `limit`; `after` resumes behind an event's id."""
        query = present(
            after=after,
            start=start,
            stop=stop,
            min_surprise=min_surprise,
            acknowledged=acknowledged,
            muted=muted,
            limit=limit,
        )
        return Listing(Page[Event], f"{self.path}/anomalies", query)


class ClientOperations(AnomalyOperations, Generic[Handle]):
    """Operations of a client whose locations are handled by `Handle`."""

    def location(self, name: str) -> Handle:
        """A handle of the location `name`, which need not exist yet; asks nothing of the server."""
        raise NotImplementedError

    @operation
    def create_location(
        self,
        name: str,
        *,
        interval_s: float,
        kind: Kind = "state",
        time_zone: str = "UTC",
        epoch: TimeLike | None = None,
        grid: Grid | Mapping[str, Any] | None = None,
        estimator: EstimatorChoice | None = None,
        order: OrderChoice | None = None,
        confidence: float | None = None,
        missing: Missing | None = None,
        hold_s: float | None = None,
        combine: Combine | None = None,
        retention: float | None = None,
        min_cells: int | None = None,
        sensor: SensorRates | Mapping[str, float] | Literal["learn"] | None = None,
        event_gap_s: float | None = None,
        calendar: str | None = None,
        pose: Position | Mapping[str, Any] | None = None,
    ) -> Plan[Handle]:
        """Make a location and return its handle; what is left out is the server's default.

        `interval_s` is the length of a sample in seconds, `time_zone` an IANA name, `grid` the cells of the
        kinds grid2d and grid3d: frame, origin (metres), resolution_m and shape. `sensor` says how often the sensor
        errs: miss and false_alarm, or "learn". `calendar` is an ISO 3166 code (GB, DE-BY), whose public holidays count
        as Sundays; `pose` is where the location stands (frame, position).
        """
        form = present(
            name=name,
            kind=kind,
            interval_s=interval_s,
            time_zone=time_zone,
            epoch=epoch,
            grid=grid.model_dump() if isinstance(grid, Grid) else grid,
            estimator=estimator,
            order=order,
            confidence=confidence,
            missing=missing,
            hold_s=hold_s,
            combine=combine,
            retention=retention,
            min_cells=min_cells,
            sensor=sensor.model_dump() if isinstance(sensor, SensorRates) else sensor,
            event_gap_s=event_gap_s,
            calendar=calendar,
            pose=pose.model_dump() if isinstance(pose, Position) else pose,
        )
        location = yield from ask(Location, post(f"{self.path}/locations", form, repeatable=False))
        return self.location(location.name)

    @operation
    def locations(self) -> Plan[list[Location]]:
        """All locations with what is known of them."""
        return Listing(Page[Location], f"{self.path}/locations", {}).everything()

    @operation
    def anomaly(self, anomaly_id: int) -> Plan[EventDetail]:
        """A stored anomaly with all of its cells, and its reasons; lists have the first 10,000 cells.

        Of one that became a part of an older anomaly, that.
        """
        return ask(EventDetail, Request("GET", f"{self.path}/anomalies/{anomaly_id}"))

    @operation
    def acknowledge(self, anomaly_id: int, note: str | None = None) -> Plan[Event]:
        """Say that an operator has seen an anomaly."""
        return (yield from ask(Event, post(f"{self.path}/anomalies/{anomaly_id}/acknowledge", present(note=note))))

    @operation
    def snooze(self, anomaly_id: int, until: TimeLike | None) -> Plan[Event]:
        """Let nobody hear of an anomaly until a time; None: from now on they do again."""
        form = {"until": None if until is None else unix(until)}
        return (yield from ask(Event, post(f"{self.path}/anomalies/{anomaly_id}/snooze", form)))

    @operation
    def mute(
        self,
        start: TimeLike,
        stop: TimeLike,
        *,
        locations: Sequence[str] | None = None,
        weekly: bool = False,
        until: TimeLike | None = None,
        note: str = "",
    ) -> Plan[Mute]:
        """Let nobody hear of anomalies in [start, stop), at some locations (names, or their beginnings and a `*`).

        `weekly`: nor at the same time of later weeks, until `until`.
        """
        form = present(
            start=unix(start),
            stop=unix(stop),
            locations=None if locations is None else [*locations],
            weekly=weekly,
            until=None if until is None else unix(until),
            note=note,
        )
        return ask(Mute, post(f"{self.path}/mutes", form, repeatable=False))

    @operation
    def mutes(self) -> Plan[Items[Mute]]:
        """When nobody hears of anomalies, and who wants that."""
        return Listing(Page[Mute], f"{self.path}/mutes", {}).everything()

    @operation
    def unmute(self, mute_id: int) -> Plan[None]:
        """Delete a mute: people hear of anomalies again."""
        yield Request("DELETE", f"{self.path}/mutes/{mute_id}", repeatable=False)


class Entries(Resource, Generic[F]):
    """Numbered things of the server."""

    page: type[Page[F]]

    @operation
    def list(self) -> Plan[Items[F]]:
        """All of them."""
        return Listing(self.page, self.path, {}).everything()

    def _remove(self, number: int) -> Plan[None]:
        yield Request("DELETE", f"{self.path}/{number}", repeatable=False)


class JobOperations(Entries[Job]):
    """Long work at the server."""

    page = Page[Job]

    @operation
    def get(self, job_id: int) -> Plan[Job]:
        """The job with this id."""
        return ask(Job, Request("GET", f"{self.path}/{job_id}"))

    @operation
    def cancel(self, job_id: int) -> Plan[None]:
        """Cancel a job that is still queued."""
        return self._remove(job_id)


class KeyOperations(Entries[Key]):
    """Who may do what (role admin)."""

    page = Page[Key]

    @operation
    def create(
        self, name: str, role: Role, *, locations: Sequence[str] | None = None, expires_at: TimeLike | None = None
    ) -> Plan[NewKey]:
        """A new key with its secret, which is shown this once only.

        `locations` are names, or what names begin with and a `*`; None: all.
        """
        limits = present(
            locations=None if locations is None else [*locations],
            expires_at=None if expires_at is None else unix(expires_at),
        )
        return ask(NewKey, post(self.path, {"name": name, "role": role, **limits}, repeatable=False))

    @operation
    def rotate(self, key_id: int, overlap_s: float = 86400.0) -> Plan[NewKey]:
        """Another key like this one, which itself expires after `overlap_s` seconds."""
        return ask(NewKey, post(f"{self.path}/{key_id}/rotate", {"overlap_s": overlap_s}, repeatable=False))

    @operation
    def delete(self, key_id: int) -> Plan[None]:
        """Take a key out of use."""
        return self._remove(key_id)
