"""From domain errors to problem documents (RFC 9457)."""

import logging
from collections.abc import Mapping, Sequence
from http import HTTPMethod, HTTPStatus
from typing import Any

import orjson
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.routing import Match, Mount

from tidemap import errors
from tidemap.api.state import state_of
from tidemap.media_types import PROBLEM
from tidemap.schemas.common import Problem, ProblemField

log = logging.getLogger(__name__)

STATUS: Mapping[type[Exception], int] = {
    errors.NotFoundError: 404,
    errors.ConflictError: 409,
    errors.UnreadableBodyError: 400,
    errors.UnsupportedMediaTypeError: 415,
    errors.BodyTooLargeError: 413,
    errors.BodyStalledError: 408,
    errors.InvalidInputError: 422,
    errors.UnauthorizedError: 401,
    errors.ForbiddenError: 403,
    errors.OtherSiteError: 403,
    errors.RateLimitError: 429,
    errors.BusyError: 503,
    errors.CorruptChunkError: 500,
    errors.SchemaVersionError: 503,
    errors.AskerLeftError: 499,
}


def look_up(table: Mapping[type[Exception], int], error: Exception, default: int) -> int:
    """The entry of the error's class or of the nearest of its bases."""
    return next((table[base] for base in type(error).__mro__ if base in table), default)


def problem_response(status: int, problem: Problem, headers: Mapping[str, str] | None = None) -> Response:
    """The response of a problem document."""
    content = orjson.dumps(problem.model_dump(exclude_none=True))
    return Response(content, status, headers, media_type=PROBLEM)


def install(app: FastAPI) -> None:
    """Answer every error of the app with a problem document."""
    app.add_exception_handler(errors.DomainError, _domain)
    app.add_exception_handler(RequestValidationError, _validation)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(Exception, _unexpected)


def _domain(request: Request, error: Exception) -> Response:
    if not isinstance(error, errors.DomainError):
        raise error
    if isinstance(error, errors.BusyError):
        state_of(request).refused.labels(error.code).inc()
    return domain_response(request.url.path, error)


def domain_response(path: str, error: errors.DomainError) -> Response:
    """The problem document of a domain error at a path."""
    status = look_up(STATUS, error, 500)
    if status == HTTPStatus.INTERNAL_SERVER_ERROR:
        log.error("%s: %s", path, error)
    fields = error.errors if isinstance(error, errors.InvalidInputError) else ()
    problem = Problem(
        type=f"urn:tidemap:problem:{error.code}",
        title=error.title,
        status=status,
        detail=str(error),
        instance=path,
        errors=[ProblemField(field=each.field, message=each.message) for each in fields] or None,
    )
    return problem_response(status, problem, headers_of(error))


def headers_of(error: Exception) -> dict[str, str]:
    """The headers that go with the answer to an error."""
    if isinstance(error, errors.UnauthorizedError):
        return {"WWW-Authenticate": "Bearer"}
    if isinstance(error, errors.BusyError):
        return {"Retry-After": str(error.retry_after_s)}
    if isinstance(error, errors.BodyTooLargeError | errors.BodyStalledError):
        return {"Connection": "close"}
    return {}


def _validation(request: Request, error: Exception) -> Response:
    if not isinstance(error, RequestValidationError):
        raise error
    details = error.errors()
    unreadable = next((each for each in details if each["type"] == "json_invalid"), None)
    if unreadable is not None:
        reason = unreadable.get("ctx", {}).get("error", "")
        return _domain(request, errors.UnreadableBodyError(f"The body is no JSON: {reason}."))
    messages: dict[str, list[str]] = {}
    for each in details:
        messages.setdefault(_location(each), []).append(_message(each))
    fields = [errors.FieldError(location, " or ".join(said)) for location, said in messages.items()]
    return _domain(request, errors.InvalidInputError(*fields))


def _location(detail: Mapping[str, Any]) -> str:
    """The field as the sender knows it: without the names that pydantic gives to alternatives of a type."""
    origin, *parts = (str(part) for part in detail["loc"])
    # The last name of a field that is not known is the sender's own, whatever it is.
    named = len(parts) - 1 if detail["type"] == "extra_forbidden" else None
    parts = [part for i, part in enumerate(parts) if i in (0, named) or part.isidentifier() or part.isdigit()]
    return "".join(f"[{part}]" if part.isdigit() else f".{part}" for part in parts).removeprefix(".") or origin


def _message(detail: Mapping[str, Any]) -> str:
    message = str(detail["msg"]).removeprefix("Value error, ")
    if detail["type"] == "extra_forbidden":
        return "this field is not known; remove it or check its spelling"
    if detail["type"] == "missing":
        return "this field is missing"
    return message if detail["type"] == "value_error" else message[:1].lower() + message[1:]


def _http(request: Request, error: Exception) -> Response:
    if not isinstance(error, HTTPException):
        raise error
    title = HTTPStatus(error.status_code).phrase
    details = {
        404: "There is nothing at this address. The addresses are listed at /api/docs.",
        400: "The body cannot be read as JSON: send UTF-8, not nested deeply.",
        405: f"{request.method} is not allowed here.",
    }
    headers = error.headers
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        headers = {"Allow": ", ".join(_allowed(request))}
        details[405] += f" Allowed: {headers['Allow']}."
    problem = Problem(
        type="about:blank",
        title=title,
        status=error.status_code,
        detail=details.get(error.status_code, str(error.detail)),
        instance=request.url.path,
    )
    return problem_response(error.status_code, problem, headers)


def _allowed(request: Request) -> Sequence[str]:
    """The methods of an address; each may have a route of its own. A mounted folder has files to read."""
    routes = [route for route in request.app.routes if not isinstance(route, Mount)]
    scope = request.scope
    methods = [
        method
        for method in HTTPMethod
        if any(route.matches({**scope, "method": method})[0] is Match.FULL for route in routes)
    ]
    return methods or [HTTPMethod.GET, HTTPMethod.HEAD]


def _unexpected(request: Request, error: Exception) -> Response:
    log.error("%s %s failed", request.method, request.url.path, exc_info=error)
    problem = Problem(
        type="about:blank",
        title="Internal error",
        status=500,
        detail="Something went wrong on the server; its log says what.",
        instance=request.url.path,
    )
    return problem_response(500, problem)
