"""Sessions in the words of messages: what the page shows."""

from collections.abc import Sequence

import numpy as np

from tidemap.services.anomalies import Anomaly
from tidemap.services.locations import LocationSummary
from tidemap.spectral.prediction import VERDICTS, verdict
from tidemap_web.viewer import colors
from tidemap_web.viewer.messages import PageMessage, ViewRequest
from tidemap_web.viewer.painted import PaintedView
from tidemap_web.viewer.span import span
from tidemap_web.viewer.surroundings import Marker


def grids(items: list[LocationSummary]) -> PageMessage:
    """The grids one can choose from."""
    return {"kind": "grids", "items": [{"name": item.name, "kind": item.kind} for item in items]}


def location(item: LocationSummary, now: float, first_update: int) -> PageMessage:
    """The chosen grid and the stretch of its timeline."""
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
        "origin_m": list(item.grid.origin) if item.grid else None,
        "now": now,
        "span": None,
    }
    if item.first_time is not None and item.last_time is not None:
        reach = span(item.first_time, item.last_time, now)
        message["span"] = {"first": reach.first, "last": reach.last, "stop": reach.stop}
    return message


def events(found: list[Anomaly]) -> PageMessage:
    """The marks on the timeline of the chosen grid."""
    return {"kind": "events", "items": [_mark(event) for event in found]}


def progress(what: str, done: float | None) -> PageMessage:
    """What is being loaded and how far that is, from 0 to 1; None: it is there."""
    return {"kind": "progress", "what": what, "done": done}


def _mark(event: Anomaly) -> PageMessage:
    return {
        "id": event.id,
        "start": event.start,
        "stop": event.stop,
        "observed": event.observed,
        "cells": event.cells_total,
        "acknowledged": event.acknowledged_by is not None,
    }


def frame(shown: PaintedView, request: ViewRequest, selected: int | None, drawn: bool) -> PageMessage:
    """What is on the screen now; `drawn` says whether there is one."""
    view, picture, revision = shown.view, shown.picture, shown.view.loaded.revision
    return {
        "kind": "frame",
        "location": shown.location.name,
        "time": view.time,
        "last": shown.location.last_time,
        "live": request.live,
        "drawn": drawn,
        "loading": shown.loading,
        "revision": revision.revision,
        "estimator": revision.estimator,
        "order": revision.order,
        "confidence": view.confidence,
        "floor": shown.taste.floor,
        "fresh_s": shown.taste.fresh_s,
        "layout": shown.taste.layout,
        "lines_m": shown.layout.lines_m,
        "cells": len(shown.board.cell),
        "predicted": picture.shown[0],
        "observed": picture.shown[1],
        "unexpected": picture.unexpected,
        "missing": picture.missing,
        "stale": picture.stale,
        "structure": picture.structure,
        "sensors": len(shown.around.tracks),
        "selected": None if selected is None else cell(shown, selected),
    }


def cell(shown: PaintedView, number: int) -> PageMessage | None:
    """One cell's facts; None when it has never been observed."""
    if not shown.is_known(number):
        return None
    seen, p, c = shown.last_seen(number), float(shown.view.probability[number]), shown.view.confidence
    return {
        "cell": number,
        "index": shown.grid.index([number])[0].tolist(),
        "position_m": [round(float(x), 3) for x in shown.grid.centre([number])[0]],
        "probability": None if np.isnan(p) else p,
        "verdict": None if np.isnan(p) else VERDICTS[int(verdict(np.float32(p), c))],
        "observed": None if seen is None else seen[0],
        "observed_time": None if seen is None else seen[1],
    }


def hovered(at: tuple[float, float], cell: PageMessage | None, marker: Marker | None) -> PageMessage:
    """What is under the pointer, if anything is."""
    return {"kind": "hovered", "at": at, "cell": cell, "marker": None if marker is None else _facts(marker)}


def markers(items: Sequence[Marker]) -> PageMessage:
    """The doors and rooms of the building, as they are at the moment that is shown."""
    return {"kind": "markers", "items": [_facts(marker) for marker in items]}


def _facts(marker: Marker) -> PageMessage:
    return {
        "name": marker.name,
        "probability": marker.probability,
        "verdict": marker.verdict,
        "observed": marker.observed,
        "observed_time": marker.observed_time,
        "colors": [colors.css(color) for color in marker.colors],
    }


def notice(reason: str, detail: str) -> PageMessage:
    """Why there is nothing to show: no-grids, no-grid, no-observations, not-found, deleted or error."""
    return {"kind": "notice", "reason": reason, "detail": detail}


def stats(token: str, shown: PaintedView | None, updates: int, idle: bool) -> PageMessage:
    """One session for GET /view/sessions; the token is shortened, for it is a secret of the tab."""
    return {
        "session": token[:6],
        "location": shown.location.name if shown else None,
        "time": shown.view.time if shown else None,
        "revision": shown.view.loaded.revision.revision if shown else None,
        "predicted": shown.picture.shown[0] if shown else 0,
        "observed": shown.picture.shown[1] if shown else 0,
        "updates": updates,
        "idle": idle,
    }
