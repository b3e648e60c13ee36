"""Sessions in the words of messages: what the page shows."""

import numpy as np

from tidemap.services.anomalies import Anomaly
from tidemap.services.locations import LocationSummary
from tidemap_web.viewer.messages import PageMessage, ViewRequest
from tidemap_web.viewer.painted import PaintedView
from tidemap_web.viewer.span import span


def grids(items: list[LocationSummary]) -> PageMessage:
    """The grids one can choose from."""
    return {"kind": "grids", "items": [{"name": item.name, "kind": item.kind} for item in items]}


def location(item: LocationSummary, events: list[Anomaly], now: float, first_update: int) -> PageMessage:
    """The chosen grid, the stretch of its timeline, and marks on it."""
    message: PageMessage = {
        "kind": "location",
        "name": item.name,
        "time_zone": item.time_zone,
        "interval_s": item.interval_s,
        "confidence": item.confidence,
        "revision": item.revision,
        "first_update": first_update,
        "shape": list(item.cells.shape),
        "frame": item.grid.frame if item.grid else None,
        "resolution_m": item.grid.resolution_m if item.grid else None,
        "now": now,
        "span": None,
        "events": [_mark(event) for event in events],
    }
    if item.first_time is not None and item.last_time is not None:
        reach = span(item.first_time, item.last_time, now)
        message["span"] = {"first": reach.first, "last": reach.last, "stop": reach.stop}
    return message


def _mark(event: Anomaly) -> PageMessage:
    return {
        "id": event.id,
        "start": event.start,
        "stop": event.stop,
        "observed": event.observed,
        "cells": event.cells_total,
        "acknowledged": event.acknowledged_by is not None,
    }


def frame(shown: PaintedView, request: ViewRequest, selected: int | None) -> PageMessage:
    """What is on the screen now."""
    state, picture = shown.state, shown.picture
    return {
        "kind": "frame",
        "location": shown.location.name,
        "time": state.time,
        "last": shown.location.last_time,
        "live": request.live,
        "revision": state.revision,
        "estimator": state.estimator,
        "order": state.order,
        "confidence": state.confidence,
        "floor": shown.taste.floor,
        "fresh_s": shown.taste.fresh_s,
        "lines_m": shown.layout.lines_m,
        "cells": len(state.cell),
        "predicted": len(picture.predicted.row),
        "observed": len(picture.observed.row),
        "unexpected": picture.unexpected,
        "missing": picture.missing,
        "stale": picture.stale,
        "structure": picture.structure,
        "selected": None if selected is None else cell(shown, selected),
    }


def cell(shown: PaintedView, number: int) -> PageMessage | None:
    """One cell's facts; None when it has never been observed."""
    state = shown.state
    rows = np.flatnonzero(state.cell == number)
    if len(rows) == 0 or state.observed is None or state.observed_time is None:
        return None
    row = int(rows[0])
    seen = int(state.observed[row])
    return {
        "cell": number,
        "index": shown.grid.index([number])[0].tolist(),
        "position_m": [round(float(x), 3) for x in shown.grid.centre([number])[0]],
        "probability": None if np.isnan(state.probability[row]) else float(state.probability[row]),
        "observed": None if seen == 2 else seen,
        "observed_time": None if seen == 2 else float(state.observed_time[row]),
    }


def notice(reason: str, detail: str) -> PageMessage:
    """Why there is nothing to show: no-grids, no-observations, not-found or error."""
    return {"kind": "notice", "reason": reason, "detail": detail}


def stats(token: str, shown: PaintedView | None, updates: int, idle: bool) -> PageMessage:
    """One session for GET /view/sessions; the token is shortened, for it is a secret of the tab."""
    return {
        "session": token[:6],
        "location": shown.location.name if shown else None,
        "time": shown.state.time if shown else None,
        "revision": shown.state.revision if shown else None,
        "predicted": len(shown.picture.predicted.row) if shown else 0,
        "observed": len(shown.picture.observed.row) if shown else 0,
        "updates": updates,
        "idle": idle,
    }
