"""The report of a location over a period: a page that prints well."""

from contextlib import suppress
from dataclasses import dataclass
from urllib.parse import urlencode

from fastapi import APIRouter, Request, Response
from starlette.datastructures import QueryParams

from tidemap.schemas.common import parse_time_text
from tidemap.services import locations
from tidemap.services.anomalies import EventQuery, newest_events
from tidemap.services.context import Context
from tidemap.storage.records import LocationRecord
from tidemap_web.pages import guard, words
from tidemap_web.pages.guarded import Facts, guarded

WEEKS = 4
"""Of history that a report is of, where nobody says otherwise, and one week of what is to come."""
EVENTS = 40


@dataclass(frozen=True, slots=True)
class Period:
    """[start, stop) in Unix seconds, and the periods of the same length before and after it."""

    start: float
    stop: float

    @classmethod
    def read(cls, query: QueryParams, first: float, last: float) -> "Period":
        """As an address asks for it, each end by itself; what is no time is as if it were left out.

        >>> Period.read(QueryParams("stop=1209600"), 0.0, 5e6)
        Period(start=0.0, stop=1209600.0)
        """
        start, stop = _time(query.get("start")), _time(query.get("stop"))
        end = last + words.WEEK_S if stop is None else stop
        begin = max(first, min(last, end) - WEEKS * words.WEEK_S) if start is None else start
        return cls(begin, end) if begin < end else cls(end - words.WEEK_S, end)

    def moved(self, periods: int, query: QueryParams) -> str:
        """The query of an earlier or later period."""
        away = periods * (self.stop - self.start)
        kept = {"cell": query["cell"]} if "cell" in query else {}
        return urlencode({**kept, "start": round(self.start + away), "stop": round(self.stop + away)})


def router(ctx: Context) -> APIRouter:
    """The page."""
    routes = APIRouter(include_in_schema=False)

    @routes.get("/locations/{name}/report", response_model=None)
    def report(request: Request, name: str) -> Response:
        """The report of one location."""
        return guarded(ctx, request, "report.html", lambda: _report(ctx, request, name))

    return routes


def _report(ctx: Context, request: Request, name: str) -> Facts:
    guard.check_location(request, name)
    location = locations.get_location(ctx, name)
    query = request.query_params
    first, last = location.first_time or ctx.clock(), location.last_time or ctx.clock()
    period = Period.read(query, first, last)
    wanted = EventQuery(location=name, start=period.start, stop=period.stop, limit=EVENTS + 1)
    found = newest_events(ctx, wanted)
    return {
        "location": location,
        "period": period,
        "cell": _cell(query.get("cell"), location),
        "events": [event for _, event in found[:EVENTS]],
        "more": len(found) > EVENTS,
        "earlier": period.moved(-1, query),
        "later": period.moved(1, query),
    }


def _cell(text: str | None, location: LocationRecord) -> int | None:
    """The cell that a report is of: the only one, or the one that is asked for and is there."""
    if location.n_cells == 1:
        return 0
    return int(text) if text and text.isascii() and text.isdigit() and int(text) < location.n_cells else None


def _time(text: str | None) -> float | None:
    with suppress(ValueError):
        return None if text is None else parse_time_text(text)
    return None
