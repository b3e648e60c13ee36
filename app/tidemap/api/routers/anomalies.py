"""/anomalies and /locations/{name}/anomalies"""

from dataclasses import dataclass, replace
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request
from starlette.responses import Response

from tidemap.api.bodies import FormRoute
from tidemap.api.dependencies import (
    After,
    Audited,
    Ctx,
    FilteringOperator,
    Id,
    Limit,
    Operator,
    TimeQuery,
    cursor,
    query_time,
)
from tidemap.api.encoding import with_etag
from tidemap.api.long_questions import answered
from tidemap.api.views.anomalies import confidence_view, detail_view, event_view, listed_view
from tidemap.formats.json_columns.parts import to_json
from tidemap.media_types import JSON
from tidemap.schemas.anomalies import (
    AcknowledgeForm,
    ConfidenceAnswer,
    DetectForm,
    Event,
    EventDetail,
    Events,
    Rule,
    SnoozeForm,
)
from tidemap.schemas.common import Page
from tidemap.services.acknowledging import acknowledge
from tidemap.services.anomalies import EventQuery, get_event, list_events
from tidemap.services.confidence import find_confidence
from tidemap.services.context import Context
from tidemap.services.detect import DetectQuery, detect
from tidemap.services.reasons import reasons
from tidemap.services.snoozing import snooze

router = APIRouter(tags=["anomalies"], route_class=FormRoute)
Surprise = Annotated[float | None, Query(ge=0, le=1)]
PerWeek = Annotated[float, Query(ge=0, le=10_000, description="How many are wanted at most.")]
Acknowledged = Annotated[bool | None, Query()]
Muted = Annotated[bool | None, Query(description="Whether all of it lies in a time that was muted. Default: both.")]


@dataclass(frozen=True, slots=True)
class EventPage:
    """The events of a page, `limit` at most; the query asks for one more, which says whether there is another page."""

    query: EventQuery
    limit: int


async def event_page(
    after: After = None,
    limit: Limit = 100,
    start: TimeQuery = None,
    stop: TimeQuery = None,
    min_surprise: Surprise = None,
    acknowledged: Acknowledged = None,
    muted: Muted = None,
) -> EventPage:
    """Which events are asked for, of all locations."""
    times = query_time("start", start), query_time("stop", stop)
    query = EventQuery(None, cursor("after", after), limit + 1, *times, min_surprise, acknowledged, muted=muted)
    return EventPage(query, limit)


AskedPage = Annotated[EventPage, Depends(event_page)]


@router.get("/anomalies", responses={200: {"model": Page[Event]}, 304: {}}, response_class=Response)
def list_everywhere(request: Request, ctx: Ctx, who: FilteringOperator, page: AskedPage) -> Response:
    """Events of all locations, oldest first; pass the last id you have seen as `after` to get newer ones only."""
    return _page(request, ctx, replace(page.query, scope=who.scope), page.limit)


@router.get("/locations/{name}/anomalies", responses={200: {"model": Page[Event]}, 304: {}}, response_class=Response)
def list_here(name: str, request: Request, ctx: Ctx, _: Operator, page: AskedPage) -> Response:
    """Events of one location, oldest first."""
    return _page(request, ctx, replace(page.query, location=name), page.limit)


def _page(request: Request, ctx: Context, query: EventQuery, limit: int) -> Response:
    events = list_events(ctx, query)
    shown = events[:limit]
    following = str(shown[-1].id) if len(events) > limit else None
    content = to_json(Page(items=[listed_view(event) for event in shown], next=following).model_dump(mode="json"))
    return with_etag(request, (content,), lambda: Response(content, media_type=JSON))


@router.post("/locations/{name}/anomalies/detect")
async def search(name: str, form: DetectForm, request: Request, ctx: Ctx, _: Operator) -> Events:
    """The events of the history by this rule and confidence; nothing is stored."""
    query = DetectQuery(**form.model_dump())
    events, revision = await answered(request, lambda check: detect(ctx, name, query, check))
    return Events(items=[event_view(event) for event in events], revision=revision)


@router.get("/anomalies/{anomaly_id}")
def get(anomaly_id: Id, ctx: Ctx, _: Operator) -> EventDetail:
    """One event with all of its cells and its reasons; of one that became a part of an older event, that."""
    event = get_event(ctx, anomaly_id)
    return detail_view(event, reasons(ctx, event))


@router.get("/locations/{name}/confidence")
async def confidence(
    name: str, request: Request, ctx: Ctx, _: Operator, false_alarms_per_week: PerWeek = 1.0, rule: Rule = "surprise"
) -> ConfidenceAnswer:
    """The confidence to give a location for so many false alarms a week, found on its own history."""
    found = await answered(request, lambda check: find_confidence(ctx, name, false_alarms_per_week, rule, check))
    return confidence_view(found)


@router.post("/anomalies/{anomaly_id}/acknowledge")
def acknowledge_event(anomaly_id: Id, ctx: Audited, principal: Operator, form: AcknowledgeForm | None = None) -> Event:
    """An operator has seen this event."""
    return event_view(acknowledge(ctx, anomaly_id, principal.name, form.note if form else None))


@router.post("/anomalies/{anomaly_id}/snooze")
def snooze_event(anomaly_id: Id, form: SnoozeForm, ctx: Audited, principal: Operator) -> Event:
    """Nobody is to hear of this event until a time: it is neither streamed nor sent, and comes back then."""
    return event_view(snooze(ctx, anomaly_id, principal.name, form.until))
