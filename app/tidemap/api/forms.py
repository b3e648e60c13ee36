"""Forms with long columns: read in pieces in a thread, so that nobody else waits for them."""

from typing import Any, TypeVar

import msgspec
from fastapi.exceptions import RequestValidationError
from pydantic import ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from tidemap.api.bodies import check_json, read_body
from tidemap.api.state import state_of
from tidemap.errors import InvalidInputError
from tidemap.formats.json_columns.text import PIECE_BYTES, fields_of, list_parts, parsed
from tidemap.media_types import JSON
from tidemap.schemas.common import Form

Filled = TypeVar("Filled", bound=Form)
COLUMN_COST = 32
"""Bytes of memory that each byte of such a form takes at most; its own included."""


async def posted_form(request: Request, form: type[Filled]) -> Filled:
    """The form in a request's body. Authenticate first.

    Raises RequestValidationError, UnreadableBodyError, InvalidInputError, and as `read_body`.
    """
    state = state_of(request)
    with state.budget.share() as share:
        content = await read_body(request, state.ctx.settings.body_limit(JSON), share)
        if content:
            check_json(request)
        await share.grow(len(content) * (COLUMN_COST - 1))
        return await run_in_threadpool(read_form, bytes(content), form)


def read_form(content: bytes, form: type[Filled]) -> Filled:
    """Parse and check a form. Raises RequestValidationError, UnreadableBodyError, InvalidInputError."""
    if not content:
        raise RequestValidationError([{"type": "missing", "loc": ("body",), "msg": "Field required"}])
    values = _values(content, form)
    if not isinstance(values, dict):
        raise InvalidInputError.at("body", "send a JSON object")
    try:
        return form.model_validate(values)
    except ValidationError as error:
        details = [{**each, "loc": ("body", *each["loc"])} for each in error.errors(include_url=False)]
        raise RequestValidationError(details) from None


def _values(content: bytes, form: type[Form]) -> Any:
    if len(content) <= PIECE_BYTES:
        return parsed(content)
    fields = [(name, msgspec.Raw, None) for name in form.model_fields]
    sent = fields_of(content, msgspec.defstruct(form.__name__, fields, forbid_unknown_fields=True))
    texts = {name: getattr(sent, name) for name in form.model_fields}
    return {name: _value(bytes(text), name) for name, text in texts.items() if text is not None}


def _value(text: bytes, field: str) -> Any:
    """A field's value; a long one is a list of numbers, times or indices."""
    if len(text) <= PIECE_BYTES:
        return parsed(text)
    values: list[Any] = []
    for part in list_parts(text, field):
        for i, value in enumerate(part):
            if isinstance(value, dict):
                raise InvalidInputError.at(f"{field}[{len(values) + i}]", "give numbers or times")
        values += part
    return values


def form_body(form: type[Form]) -> dict[str, Any]:
    """What OpenAPI says of the body of a route that reads its form itself; the schema is added with the document."""
    schema = {"$ref": f"#/components/schemas/{form.__name__}"}
    return {"requestBody": {"required": True, "content": {JSON: {"schema": schema}}}}
