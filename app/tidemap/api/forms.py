"""Forms with long columns: read in pieces in a thread, so that nobody else waits for them."""

import json
from collections.abc import Iterator
from typing import Any, TypeVar

import msgspec
from fastapi.exceptions import RequestValidationError
from pydantic import ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from tidemap.api.bodies import check_json, read_body
from tidemap.api.state import state_of
from tidemap.errors import InvalidInputError, UnreadableBodyError
from tidemap.schemas.common import Form
from tidemap.settings import JSON

Filled = TypeVar("Filled", bound=Form)
COLUMN_COST = 24
"""Bytes of memory that each byte of such a form takes at most; its own included."""
PIECE_BYTES = 1 << 16
"""Text that is read at once: a millisecond's work."""


async def posted_form(request: Request, form: type[Filled]) -> Filled:
    """The form in a request's body. Authenticate first.

    Raises RequestValidationError, UnreadableBodyError, InvalidInputError, and as `read_body`.
    """
    state = state_of(request)
    with state.budget.share() as share:
        content = await read_body(request, state.ctx.settings.body_limit(JSON), share)
        check_json(request)
        await share.grow(len(content) * (COLUMN_COST - 1))
        return await run_in_threadpool(read_form, bytes(content), form)


def read_form(content: bytes, form: type[Filled]) -> Filled:
    """Parse and check a form. Raises RequestValidationError, UnreadableBodyError, InvalidInputError."""
    try:
        return form.model_validate(_values(content, form))
    except ValidationError as error:
        details = [{**each, "loc": ("body", *each["loc"])} for each in error.errors(include_url=False)]
        raise RequestValidationError(details) from None


def _values(content: bytes, form: type[Form]) -> Any:
    if len(content) <= PIECE_BYTES:
        return _parsed(content)
    fields = msgspec.defstruct(
        form.__name__, [(name, msgspec.Raw, msgspec.UNSET) for name in form.model_fields], forbid_unknown_fields=True
    )
    try:
        raw = msgspec.json.decode(content, type=fields)
    except msgspec.ValidationError as error:
        name = str(error).partition("`")[2].partition("`")[0]
        raise InvalidInputError.at(name or "body", "this field is not known; remove it or check its spelling") from None
    except (msgspec.DecodeError, RecursionError) as error:
        raise UnreadableBodyError(f"The body is no JSON: {error}.") from None
    sent = {name: getattr(raw, name) for name in form.model_fields}
    return {name: _value(bytes(text), name) for name, text in sent.items() if text is not msgspec.UNSET}


def _value(text: bytes, field: str) -> Any:
    """A field's value; a long one is a list of numbers or times."""
    text = text.strip()
    if len(text) <= PIECE_BYTES:
        return _parsed(text)
    if not text.startswith(b"[") or any(mark in text[1:] for mark in (b"[", b"{", b"\\")):
        raise InvalidInputError.at(field, "so long a value must be a list of numbers or times")
    return [value for piece in _pieces(text[1:-1]) for value in _parsed(b"[" + piece + b"]")]


def _pieces(items: bytes) -> Iterator[bytes]:
    """The text of a list's items, cut between items: after a comma, in text after a quote and a comma."""
    separator = b'",' if b'"' in items else b","
    start = 0
    while len(items) - start > PIECE_BYTES:
        end = items.find(separator, start + PIECE_BYTES)
        if end < 0:
            break
        end += len(separator) - 1
        yield items[start:end]
        start = end + 1
    yield items[start:]


def _parsed(text: bytes) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UnreadableBodyError(f"The body is no JSON: {error}.") from None


def form_body(form: type[Form]) -> dict[str, Any]:
    """What OpenAPI says of the body of a route that reads its form itself; the schema is added with the document."""
    schema = {"$ref": f"#/components/schemas/{form.__name__}"}
    return {"requestBody": {"required": True, "content": {JSON: {"schema": schema}}}}
