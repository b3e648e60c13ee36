"""What routes depend on: the context, bodies within their limit, times and cursors of queries."""

import json
from typing import Annotated

from fastapi import Depends, Query, Request
from pydantic import AfterValidator, BeforeValidator, WithJsonSchema
from starlette.concurrency import run_in_threadpool

from tidemap.api.addresses import BASE
from tidemap.api.auth import Admission, authenticate, require, require_filtering, require_sender
from tidemap.api.bodies import read_body
from tidemap.api.budget import Share
from tidemap.api.state import state_of
from tidemap.errors import InvalidInputError
from tidemap.formats.registry import Body
from tidemap.schemas.common import TIME_SCHEMA, Text, parse_time_text
from tidemap.services.audit import audited
from tidemap.services.context import Context
from tidemap.services.keys import Principal

MAX_ID = 2**63 - 1


async def context(request: Request) -> Context:
    """The context of this server. A function that is not async would take a turn in a thread."""
    ctx: Context = state_of(request).ctx
    return ctx


Ctx = Annotated[Context, Depends(context)]


async def audited_context(request: Request, ctx: Ctx) -> Context:
    """The context of this server; what a request writes with it comes with an entry of the audit log."""
    principal = await run_in_threadpool(authenticate, request)
    action = f"{request.method} {request.scope['route'].path.removeprefix(BASE)}"
    said = (request.url.query, await _form_text(request))
    return audited(ctx, principal, action, request.url.path.removeprefix(BASE), " ".join(filter(None, said)))


async def _form_text(request: Request) -> str:
    """The JSON form that was read within its limit, as compact text; empty of a route that takes none."""
    if request.scope["route"].body_field is None:
        return ""
    try:
        form = json.loads(await request.body())
    except ValueError:
        # What is no JSON is refused, and changes nothing.
        return ""
    return json.dumps(form, separators=(",", ":"), ensure_ascii=False)


async def posted_body(request: Request, time: str | None, layout: str | None, share: Share) -> Body:
    """The unpacked body of a request, within the limit, with `share` grown to the memory that parsing it takes.

    `time` and `layout` are those of a grid. Raises InvalidInputError, and as `read_body`.
    """
    ctx: Context = state_of(request).ctx
    seconds = query_time("time", time)
    media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    content = await read_body(request, ctx.settings.body_limit(media_type), share)
    body = Body(content, media_type, seconds, layout)
    await share.grow(len(content) * (body.cost - 1))
    return body


def query_time(name: str, value: str | None) -> float | None:
    """Unix seconds of a query parameter. Raises InvalidInputError naming it."""
    if value is None:
        return None
    try:
        return parse_time_text(value)
    except ValueError as error:
        raise InvalidInputError.at(name, str(error)) from None


def cursor(name: str, value: str | None) -> int | None:
    """The id in a cursor. Raises InvalidInputError naming it."""
    if value is None:
        return None
    if not (value.isascii() and value.isdigit() and len(value) < 19):
        raise InvalidInputError.at(name, "give the `next` of the page before, or the id of an item")
    return int(value)


def _storable(number: int) -> int:
    """The id, or the greatest or least that a database holds, which nothing has."""
    return max(-MAX_ID, min(number, MAX_ID))


Audited = Annotated[Context, Depends(audited_context)]
Id = Annotated[int, AfterValidator(_storable)]
Robot = Annotated[Admission, Depends(require_sender("robot"))]
Asker = Annotated[Admission, Depends(require_sender("operator"))]
Operator = Annotated[Principal, Depends(require("operator"))]
FilteringOperator = Annotated[Principal, Depends(require_filtering("operator"))]
"""Of routes that show only what is in the scope of who asks."""
Admin = Annotated[Principal, Depends(require("admin"))]
TimeQuery = Annotated[str | None, Query(description="Unix seconds, or ISO 8601 with a zone.")]
RequiredTime = Annotated[float, BeforeValidator(parse_time_text), WithJsonSchema(TIME_SCHEMA)]
Limit = Annotated[int, Query(ge=1, le=1000)]
After = Annotated[Text | None, Query(description="The `next` of the page before.")]
