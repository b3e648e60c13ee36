"""Operations on one location: what it is, what it has observed and what it predicts."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.client import answers, npy
from tidemap.client.administration import AnomalyOperations
from tidemap.client.arrow import pa
from tidemap.client.encoding import Numbers
from tidemap.client.operation import operation, paged, posting, scanning
from tidemap.client.plans import Listing, Plan, Request, ask
from tidemap.client.posting import Postable, observation, occupancy, sighting, whole
from tidemap.client.requests import name_of, path_of, post, present, send
from tidemap.client.ros import is_occupancy_grid
from tidemap.client.scanning import scan as scan_post
from tidemap.client.times import TimeLike, TimesLike, unix, unix_array
from tidemap.client.waiting import ended, until, wait_s
from tidemap.media_types import ARROW, JSON
from tidemap.schemas.anomalies import ConfidenceAnswer, Events, Rule
from tidemap.schemas.common import Page
from tidemap.schemas.jobs import Job
from tidemap.schemas.locations import EstimatorChoice, EstimatorName, Location, OrderChoice
from tidemap.schemas.maps import Evaluation, ExportFormat, ExportMode, ExportSource, Model
from tidemap.schemas.observations import Deleted, Layout
from tidemap.schemas.scans import RegistrationMode, ScanAccepted, ScanItem, Verdict


class LocationOperations(AnomalyOperations):
    """Operations of a handle of one location."""

    @property
    def name(self) -> str:
        """The location's name."""
        return name_of(self.path)

    @operation
    def get(self) -> Plan[Location]:
        """The location with its settings and what is known of it."""
        return ask(Location, Request("GET", self.path))

    @operation
    def patch(self, /, **changes: Any) -> Plan[Location]:
        """Change settings: those of `create_location` but kind, interval_s, epoch and grid."""
        location = yield from ask(Location, send("PATCH", self.path, changes, {}, repeatable=True))
        self.path = path_of(location.name)
        return location

    @operation
    def delete_observations(self, start: TimeLike, stop: TimeLike, source: str | None = None) -> Plan[Deleted]:
        """Delete what was measured in [start, stop), by one robot or by all of them (role admin)."""
        query = present(start=start, stop=stop, source=source)
        return ask(Deleted, Request("DELETE", f"{self.path}/observations", query, repeatable=False))

    @operation
    def delete(self) -> Plan[None]:
        """Delete the location and everything stored of it."""
        yield Request("DELETE", self.path, repeatable=False)

    @posting
    def observe(
        self,
        time: TimesLike,
        state: Any,
        cell: Numbers | None = None,
        *,
        source: str | None = None,
        idempotency_key: str | None = None,
    ) -> Postable:
        """Store measurements: columns (or one) time, state (1 occupied, 0 free) and, for grids, cell.

        A state None or NaN says that the sensor is unavailable: with `missing: hold` nothing is held from then on.
        A cell is its linear index, or a row [i, j, k]. Posts in batches, each durable when it is answered and
        stored once however often it is sent; an `idempotency_key` makes that hold across calls and restarts.

        Returns `Accepted`. With an outbox it returns `Queued` as soon as all of it is on the disk, or raises
        OutboxError (OutboxFullError) and has kept nothing of it.
        """
        return observation(self.path, time, state, cell, source=source, key=idempotency_key)

    @posting
    def observe_grid(
        self,
        time: TimeLike,
        *,
        occupied: Numbers = (),
        free: Numbers = (),
        grid: Any = None,
        layout: Layout | None = None,
        source: str | None = None,
        idempotency_key: str | None = None,
    ) -> Postable:
        """Store one observation of a grid: cells seen occupied and cells seen free, as indices or rows [i, j, k].

        Or all of it as an array `grid` of the location's shape (nx, ny): 1 occupied, 0 free, -1 (or 255) not seen.
        With `layout` "ros", or as something shaped like nav_msgs/OccupancyGrid, it is (ny, nx), rows of one y, with 65
        to 100 occupied, 0 to 25 free, and others not seen.
        Returns and raises what `observe` does.
        """
        if grid is not None:
            if len(occupied) or len(free):
                raise ValueError("give either `grid` or the cells occupied and free")
            if layout == "ros" or is_occupancy_grid(grid):
                return occupancy(self.path, time, grid, source=source, key=idempotency_key)
            return whole(self.path, time, grid, source=source, key=idempotency_key)
        return sighting(self.path, time, occupied, free, source=source, key=idempotency_key)

    @scanning
    def observe_scan(
        self,
        scan: Any,
        map_from_sensor: Any,
        time: TimeLike | None = None,
        *,
        covariance: Any = None,
        max_range: float | None = None,
        min_hits: int | None = None,
        frame: str | None = None,
        registration: RegistrationMode | None = None,
        source: str | None = None,
        idempotency_key: str | None = None,
    ) -> Postable:
        """Store what a scan saw: its rays become one observation, from a pose that the map has put right.

        `scan`: points (n, 3), or (n, 2) of a planar sensor, in metres in the sensor's frame; or something shaped like
        sensor_msgs/LaserScan or PointCloud2, whose stamp is the time where none is given. `map_from_sensor`: 4x4, or
        (x, y, z, qx, qy, qz, qw), or shaped like geometry_msgs/Transform or Pose. `covariance` (6, 6) of x, y, z and
        the rotations about them: with it the scan is registered. Beyond `max_range` (m) rays hit nothing.

        Returns `ScanAccepted`; its `registration` says what became of the pose. With an outbox as `observe`.
        """
        said = {"max_range": max_range, "min_hits": min_hits, "frame": frame, "registration": registration}
        return scan_post(
            self.path,
            scan,
            map_from_sensor,
            time,
            covariance=covariance,
            **said,
            source=source,
            key=idempotency_key,
        )

    @paged
    def scans(self, registration: Verdict | None = None, limit: int | None = None) -> Listing[ScanItem]:
        """What became of scans, newest first, over all pages of `limit`; of one verdict or of all."""
        return Listing(Page[ScanItem], f"{self.path}/scans", present(registration=registration, limit=limit))

    @operation
    def scan_points(self, scan_id: int) -> Plan[NDArray[np.float32]]:
        """The points (n, 3) of a scan in quarantine, in metres in the sensor's frame."""
        response = yield Request("GET", f"{self.path}/scans/{scan_id}/points")
        return npy.read(response.content)

    @operation
    def replay_scan(self, scan_id: int) -> Plan[ScanAccepted]:
        """Register a scan in quarantine again, by the model of now."""
        return ask(ScanAccepted, Request("POST", f"{self.path}/scans/{scan_id}/replay", repeatable=False))

    @operation
    def delete_scan(self, scan_id: int) -> Plan[None]:
        """Drop a scan from the list, with its points; what it saw stays in the map."""
        yield Request("DELETE", f"{self.path}/scans/{scan_id}", repeatable=False)

    @operation
    def update(
        self,
        *,
        wait: bool | float = True,
        start: TimeLike | None = None,
        stop: TimeLike | None = None,
        estimator: EstimatorChoice | None = None,
        order: OrderChoice | None = None,
    ) -> Plan[Job]:
        """Refit the spectrum from the history and return the job.

        `wait`: until the job has ended (True), at most so many seconds, or not at all (False). Look at the
        job's `state`: it may have failed.
        """
        deadline = until(wait)
        form = present(start=start, stop=stop, estimator=estimator, order=order)
        asked_s = wait_s(deadline)
        request = post(f"{self.path}/update", form, {"wait": asked_s})
        job = yield from ask(Job, replace(request, waits_s=asked_s))
        return (yield from ended(job, deadline))

    @operation
    def predict(
        self,
        time: TimesLike,
        cell: Any = None,
        *,
        confidence: float | None = None,
        order: int | None = None,
        estimator: EstimatorName | None = None,
        as_of: TimeLike | None = None,
        given: answers.Given = "observations",
    ) -> Plan[answers.Prediction]:
        """Probability, state and entropy of cells (all of them, if none are named) at times.

        `as_of` and `given` are as of `state`.
        """
        cells = None if cell is None else np.atleast_1d(np.asarray(cell)).tolist()
        asked = {"confidence": confidence, "order": order, "estimator": estimator, "as_of": as_of, "given": given}
        form = present(cell=cells, **asked)
        response = yield post(f"{self.path}/predict", {"time": unix_array(time).tolist()} | form)
        return answers.prediction(response.content)

    @operation
    def state(
        self,
        time: TimeLike | None = None,
        *,
        confidence: float | None = None,
        order: int | None = None,
        estimator: EstimatorName | None = None,
        bbox: tuple[float, float, float, float, float, float] | None = None,
        observed: bool = False,
        as_of: TimeLike | None = None,
        given: answers.Given = "observations",
        last_seen: bool = False,
    ) -> Plan[answers.State]:
        """The map at a time (now, if none is given), or its part in bbox [x0,y0,z0,x1,y1,z1] (metres).

        Where the time is later than a cell's latest reading at or before `as_of` (now, if none is given), the answer is
        conditioned on that reading; `given` "model" is the rhythm alone. `observed` adds what was last seen of each
        cell at that time, `last_seen` when the reading that was used was made.
        """
        query = present(
            time=None if time is None else unix(time),
            confidence=confidence,
            order=order,
            estimator=estimator,
            bbox=_corners(bbox),
            observed=observed or None,
            as_of=as_of,
            given=given,
            last_seen=last_seen or None,
        )
        response = yield Request("GET", f"{self.path}/state", query, headers={"Accept": JSON if pa is None else ARROW})
        return answers.state(response.content, response.headers["Content-Type"])

    @operation
    def export(
        self,
        format: ExportFormat,
        time: TimeLike | None = None,
        *,
        confidence: float | None = None,
        source: ExportSource = "predicted",
        mode: ExportMode = "trinary",
        given: answers.Given = "observations",
        z_min: float | None = None,
        z_max: float | None = None,
    ) -> Plan[answers.MapFile]:
        """The map at a time (now, if none is given) as a file: its `content` and a `name` for it.

        `mode` "trinary" says occupied, free or unknown by confidence, "scale" gives probabilities (octomap: `.ot` for
        `.bt`). `source` "observed" is what was seen last of each cell, also before there is a model. A height band
        [z_min, z_max] (metres) keeps the layers with their centre in it; nav2 makes one layer of them.
        """
        query = present(
            format=format,
            time=None if time is None else unix(time),
            confidence=confidence,
            source=source,
            mode=mode,
            given=given,
            z_min=z_min,
            z_max=z_max,
        )
        response = yield Request("GET", f"{self.path}/export", query)
        return answers.map_file(response.content, response.headers)

    @operation
    def series(
        self,
        cell: int = 0,
        start: TimeLike | None = None,
        stop: TimeLike | None = None,
        step: float | None = None,
    ) -> Plan[answers.Series]:
        """One cell's observations and probability in [start, stop), every `step` seconds."""
        query = present(cell=cell, start=start, stop=stop, step=step)
        response = yield Request("GET", f"{self.path}/series", query)
        return answers.series(response.content)

    @operation
    def information(
        self,
        time: TimeLike | None = None,
        *,
        start: TimeLike | None = None,
        stop: TimeLike | None = None,
        step: float | None = None,
        bbox: tuple[float, float, float, float, float, float] | None = None,
        best: int | None = None,
        miss: float | None = None,
        false_alarm: float | None = None,
        as_of: TimeLike | None = None,
        given: answers.Given = "observations",
    ) -> Plan[answers.Information]:
        """What looking at the location, or at its part in bbox, is expected to say, in nats.

        At a time (now, if none is given) of every cell; or, by any of start, stop, step and best, in a window (the next
        day) for all cells together, with the `best` times. `miss` and `false_alarm` are how often looks err, by default
        as the location's sensor does; `as_of` and `given` are as of `state`.
        """
        query = present(
            time=None if time is None else unix(time),
            start=start,
            stop=stop,
            step=step,
            bbox=_corners(bbox),
            best=best,
            miss=miss,
            false_alarm=false_alarm,
            as_of=as_of,
            given=given,
        )
        response = yield Request("GET", f"{self.path}/information", query)
        return answers.information(response.content)

    @operation
    def model(self, cell: int = 0, order: int | None = None) -> Plan[Model]:
        """Spectrum and outliers of one cell; `order` recomputes them at another order without storing."""
        return ask(Model, Request("GET", f"{self.path}/model", present(cell=cell, order=order)))

    @operation
    def evaluate(
        self,
        *,
        orders: list[int] | None = None,
        horizons_s: list[float] | None = None,
        start: TimeLike | None = None,
        stop: TimeLike | None = None,
        estimators: list[EstimatorName] | None = None,
        confidence: float | None = None,
        time: TimesLike | None = None,
        state: Any = None,
        train_start: TimeLike | None = None,
        train_stop: TimeLike | None = None,
    ) -> Plan[Evaluation]:
        """Score estimators and orders against the history in [start, stop), or against measurements given.

        By `horizons_s` how good the answer given a reading that many seconds old is, beside the rhythm and persistence
        alone; what answers is learned from the past of what is scored.
        """
        form = present(
            orders=orders,
            horizons_s=horizons_s,
            start=start,
            stop=stop,
            estimators=estimators,
            confidence=confidence,
            time=None if time is None else unix_array(time).tolist(),
            state=None if state is None else np.asarray(state).astype(int).tolist(),
            train_start=None if train_start is None else unix(train_start),
            train_stop=None if train_stop is None else unix(train_stop),
        )
        return ask(Evaluation, post(f"{self.path}/evaluate", form))

    @operation
    def find_confidence(
        self, *, false_alarms_per_week: float | None = None, rule: Rule | None = None
    ) -> Plan[ConfidenceAnswer]:
        """The confidence that would have given so many anomalies a week (1 unless said) on this location's history,
        and what others would have given. Nothing is changed: pass it to `patch(confidence=...)`."""
        query = present(false_alarms_per_week=false_alarms_per_week, rule=rule)
        return ask(ConfidenceAnswer, Request("GET", f"{self.path}/confidence", query))

    @operation
    def detect(
        self,
        start: TimeLike,
        stop: TimeLike,
        *,
        confidence: float | None = None,
        rule: Rule | None = None,
        order: int | None = None,
        estimator: EstimatorName | None = None,
    ) -> Plan[Events]:
        """Anomalies computed over the history in [start, stop); nothing is stored."""
        form = present(start=start, stop=stop, confidence=confidence, rule=rule, order=order, estimator=estimator)
        return (yield from ask(Events, post(f"{self.path}/anomalies/detect", form)))


def _corners(bbox: tuple[float, ...] | None) -> str | None:
    """A box as an address has it."""
    return None if bbox is None else ",".join(map(str, bbox))
