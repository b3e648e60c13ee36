"""/locations/{name}/scans"""

import asyncio
from contextlib import ExitStack
from functools import partial
from typing import Annotated, Any

from anyio import from_thread
from fastapi import APIRouter, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from tidemap.api.auth import confirming
from tidemap.api.bodies import FormRoute, read_body
from tidemap.api.dependencies import After, Audited, Ctx, Id, Limit, Operator, Robot, cursor
from tidemap.api.encoding import LeasedResponse
from tidemap.api.long_questions import Check, answered
from tidemap.api.routers.observations import IdempotencyKey, Source, name_of
from tidemap.api.scan_body import read_scan
from tidemap.api.state import state_of
from tidemap.api.views.scans import scan_accepted_view, scan_view
from tidemap.formats.npy import write_grid
from tidemap.formats.scan_body import COST, ScanBody
from tidemap.media_types import ARROW, JSON, MULTIPART, NPY, PCD, PLY
from tidemap.schemas.common import Page
from tidemap.schemas.scans import ScanAccepted, ScanItem, Verdict
from tidemap.services.posts import Post
from tidemap.services.refusals import counting
from tidemap.services.scans import ScanQuery, delete_scan, kept_bytes, list_scans, points_of, replay_scan, submit_scan

router = APIRouter(prefix="/locations/{name}/scans", tags=["scans"], route_class=FormRoute)

POINTS_COST = 3
"""Points that are asked for are in memory packed, unpacked and as a file."""

_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "description": "One scan: a JSON header and, beside it, its points in the sensor's frame, in metres; or the "
        "ranges of a planar laser as JSON alone. May be gzip- or zstd-encoded (Content-Encoding).",
        "content": {
            MULTIPART: {
                "schema": {
                    "type": "object",
                    "properties": {
                        "header": {"$ref": "#/components/schemas/ScanHeader"},
                        "points": {
                            "type": "string",
                            "format": "binary",
                            "description": "An npy array (n, 3), or (n, 2) of a planar sensor, of float32 or float64; "
                            "an Arrow IPC stream with the columns x, y and z; a PCD or a PLY file. NaN is left out.",
                        },
                        "ranges": {
                            "type": "string",
                            "format": "binary",
                            "description": "Instead of points: an npy array (n,) of ranges. NaN is left out; infinity "
                            "clears up to max_range.",
                        },
                    },
                    "required": ["header"],
                },
                "encoding": {
                    "header": {"contentType": JSON},
                    "points": {"contentType": ", ".join((NPY, ARROW, PCD, PLY))},
                    "ranges": {"contentType": NPY},
                },
            },
            JSON: {"schema": {"$ref": "#/components/schemas/RangesScan"}},
        },
    }
}


@router.post(
    "", status_code=201, openapi_extra=_BODY, response_model=ScanAccepted, responses={200: {"model": ScanAccepted}}
)
async def post(
    name: str,
    robot: Robot,
    request: Request,
    source: Source = None,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Post a scan: its pose is put right by the map, its rays become one observation; answered after the commit.

    The same Idempotency-Key with the same scan again is answered 200 with `duplicate` true; nothing is stored twice.
    """
    state, source = state_of(request), source or name_of(robot.principal)
    with state.budget.share() as share, counting(state.ctx, name, source):
        content_type = request.headers.get("content-type", "")
        limit = state.ctx.settings.body_limit(content_type.partition(";")[0].strip().lower())
        body = ScanBody(await read_body(request, limit, share), content_type)
        await share.grow(len(body.content) * (body.cost - 1))
        await share.grow(await run_in_threadpool(body.hidden_bytes) * body.cost)
        sent = Post(body, source, idempotency_key, robot.claim)
        result = await confirming(request, robot, submit_scan(state.ctx, name, sent, partial(read_scan, body)))
    return Response(scan_accepted_view(result).model_dump_json(), 200 if result.duplicate else 201, media_type=JSON)


@router.get("")
def list_all(
    name: str,
    ctx: Ctx,
    _: Operator,
    registration: Annotated[Verdict | None, Query(description="Those with this verdict.")] = None,
    limit: Limit = 100,
    after: After = None,
) -> Page[ScanItem]:
    """What became of the scans of a location, newest first."""
    records = list_scans(ctx, name, ScanQuery(registration, cursor("after", after), limit + 1))
    items = [scan_view(record) for record in records[:limit]]
    return Page(items=items, next=str(items[-1].id) if len(records) > limit else None)


@router.get(
    "/{scan_id}/points",
    response_class=Response,
    responses={200: {"content": {NPY: {"schema": {"type": "string", "format": "binary"}}}}},
)
async def points(name: str, scan_id: Id, request: Request, ctx: Ctx, _: Operator) -> Response:
    """The points of a scan in quarantine, (n, 3) float32 in metres in the sensor's frame, as an npy file."""
    lease = ExitStack()
    share = lease.enter_context(state_of(request).budget.share())

    def file(_: Check) -> bytes:
        from_thread.run(share.grow, POINTS_COST * kept_bytes(ctx, name, scan_id))
        return b"".join(write_grid(points_of(ctx, name, scan_id)))

    with lease:
        content = await answered(request, file)
        return LeasedResponse(content, NPY, lease.pop_all())


@router.post("/{scan_id}/replay")
async def replay(name: str, scan_id: Id, request: Request, ctx: Audited, _: Operator) -> ScanAccepted:
    """Register a scan in quarantine again, by the model of now; where that succeeds, what it saw is stored."""
    with state_of(request).budget.share() as share:
        await share.grow(COST * await run_in_threadpool(kept_bytes, ctx, name, scan_id))
        return scan_accepted_view(await asyncio.wrap_future(ctx.parsing.submit(replay_scan, ctx, name, scan_id)))


@router.delete("/{scan_id}", status_code=204)
def delete(name: str, scan_id: Id, ctx: Audited, _: Operator) -> None:
    """Drop a scan from the list, with its points; what it saw stays in the map."""
    delete_scan(ctx, name, scan_id)
