"""Operations on one location: what it is, what it has observed and what it predicts."""

from dataclasses import replace
from typing import Any

import numpy as np

from tidemap.client import answers
from tidemap.client.administration import AnomalyOperations
from tidemap.client.arrow import pa
from tidemap.client.encoding import Numbers
from tidemap.client.operation import operation, posting
from tidemap.client.plans import Plan, Request, ask
from tidemap.client.posting import Postable, observation, sighting, whole
from tidemap.client.requests import name_of, path_of, post, present, send
from tidemap.client.times import TimeLike, TimesLike, unix, unix_array
from tidemap.client.waiting import ended, until, wait_s
from tidemap.media_types import ARROW, JSON
from tidemap.schemas.anomalies import Events, Rule
from tidemap.schemas.jobs import Job
from tidemap.schemas.locations import EstimatorChoice, EstimatorName, Location, OrderChoice
from tidemap.schemas.maps import Evaluation, Model
from tidemap.schemas.observations import Deleted


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
        source: str | None = None,
        idempotency_key: str | None = None,
    ) -> Postable:
        """Store one observation of a grid: cells seen occupied and cells seen free, as indices or rows [i, j, k].

        Or all of it as an array `grid` of the location's shape: 1 occupied, 0 free, -1 (or 255) not seen.
        Returns and raises what `observe` does.
        """
        if grid is not None:
            if len(occupied) or len(free):
                raise ValueError("give either `grid` or the cells occupied and free")
            return whole(self.path, time, grid, source=source, key=idempotency_key)
        return sighting(self.path, time, occupied, free, source=source, key=idempotency_key)

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
            bbox=None if bbox is None else ",".join(map(str, bbox)),
            observed=observed or None,
            as_of=as_of,
            given=given,
            last_seen=last_seen or None,
        )
        response = yield Request("GET", f"{self.path}/state", query, headers={"Accept": JSON if pa is None else ARROW})
        return answers.state(response.content, response.headers["Content-Type"])

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
    def model(self, cell: int = 0, order: int | None = None) -> Plan[Model]:
        """Spectrum and outliers of one cell; `order` recomputes them at another order without storing."""
        return ask(Model, Request("GET", f"{self.path}/model", present(cell=cell, order=order)))

    @operation
    def evaluate(
        self,
        *,
        orders: list[int],
        start: TimeLike | None = None,
        stop: TimeLike | None = None,
        estimators: list[EstimatorName] | None = None,
        confidence: float | None = None,
        time: TimesLike | None = None,
        state: Any = None,
        train_start: TimeLike | None = None,
        train_stop: TimeLike | None = None,
    ) -> Plan[Evaluation]:
        """Score estimators and orders against the history in [start, stop), or against measurements given."""
        form = present(
            orders=list(orders),
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
