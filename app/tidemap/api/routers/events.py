"""GET /events: the messages of the WebSocket as Server-Sent Events."""

from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from tidemap.api.dependencies import After
from tidemap.api.listening import POSITION, wanted_events
from tidemap.api.parameters import StrictRoute
from tidemap.api.server_sent import ServerSentEvents
from tidemap.media_types import EVENT_STREAM
from tidemap.schemas.common import Text

router = APIRouter(tags=["events"], route_class=StrictRoute)
_EXAMPLE = (
    'retry: 2000\nid: 41\n\nid: 42\ndata: {"kind":"anomaly","location":"office-door","id":42,'
    '"time":"2026-03-02T02:10:07Z","start":"2026-03-02T02:10:00Z","observed":1}\n\n: still here\n\n'
)
_ANSWER: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "Endless. Each event's data is a message as on the WebSocket; an anomaly's `id` is that of its "
        "event, so that a reader who reconnects misses none. A comment comes when nothing else does.",
        "content": {EVENT_STREAM: {"schema": {"type": "string"}, "example": _EXAMPLE}},
        "headers": {POSITION: {"description": "The last anomaly before the first.", "schema": {"type": "string"}}},
    }
}
Kinds = Annotated[
    list[Text] | None,
    Query(description="`observation`, `anomaly`, `update`, `job`, `location`; several, or joined by `,` or `|`."),
]
LastEventId = Annotated[
    Text | None, Header(alias=POSITION, description="The last `id` that came; resumes behind it and wins over `after`.")
]


@router.get("/events", responses=_ANSWER, response_class=Response)
async def stream(
    request: Request,
    location: Text | None = None,
    kind: Kinds = None,
    after: After = None,
    last_event_id: LastEventId = None,
) -> Response:
    """Messages as they happen, after the anomalies that were missed. A reader that does not keep up is dropped."""
    wanted = await run_in_threadpool(wanted_events, request, location, kind or (), last_event_id or after)
    return ServerSentEvents(request, wanted)
