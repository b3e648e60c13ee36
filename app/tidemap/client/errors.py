"""What a call of the client can fail with, in the server's own words."""

from collections.abc import Sequence
from http import HTTPStatus

import httpx
from pydantic import ValidationError

from tidemap.schemas.common import Problem, ProblemField


class TidemapError(Exception):
    """The server refused a request (RFC 9457).

    `status` is the HTTP status, `errors` the offending fields if the server named any, `type` the kind of
    problem (its end is a stable code such as `no-model`), `retry_after_s` the pause the server asked for.
    """

    def __init__(
        self,
        status: int,
        title: str,
        detail: str,
        errors: Sequence[ProblemField] = (),
        type: str = "about:blank",
        retry_after_s: float | None = None,
    ) -> None:
        super().__init__(status, title, detail, errors, type, retry_after_s)
        self.status = status
        self.title = title
        self.detail = detail
        self.errors = list(errors)
        self.type = type
        self.retry_after_s = retry_after_s

    def __str__(self) -> str:
        return f"{self.title} ({self.status}): {self.detail}"


class UnreachableError(TidemapError):
    """No answer came: the server is down, out of reach or too slow. `status` is 0, the cause is chained.

    `where` names the host, its port and the proxy in between.
    """

    def __init__(self, where: str, cause: Exception) -> None:
        super().__init__(0, "Server unreachable", f"{where}: {str(cause) or type(cause).__name__}")
        self.__cause__ = cause


class OutboxError(Exception):
    """The file of the outbox cannot be used, or not for this; the message says which file and why."""


class OutboxFullError(OutboxError):
    """What was observed does not fit into the outbox any more; nothing of it was kept."""


def problem(status: int, content: bytes, retry_after: str | None = None) -> TidemapError:
    """The error of an answer that is no success; also when the body is not a problem document."""
    pause_s = _seconds(retry_after)
    try:
        said = Problem.model_validate_json(content)
    except ValidationError:
        return TidemapError(status, _phrase(status), _excerpt(content), retry_after_s=pause_s)
    return TidemapError(status, said.title, said.detail, said.errors or (), said.type, pause_s)


def problem_of(response: httpx.Response) -> TidemapError:
    """The error that `response` carries."""
    return problem(response.status_code, response.content, response.headers.get("Retry-After"))


def _seconds(retry_after: str | None) -> float | None:
    """Retry-After in seconds; its form as a date is not used by this server and is left to the backoff.

    >>> _seconds("2"), _seconds("Wed, 21 Oct 2026 07:28:00 GMT"), _seconds(None)
    (2.0, None, None)
    """
    return float(retry_after) if retry_after is not None and retry_after.strip().isdecimal() else None


def _phrase(status: int) -> str:
    try:
        return HTTPStatus(status).phrase
    except ValueError:
        return "Error"


def _excerpt(content: bytes) -> str:
    return content[:500].decode("utf-8", "replace") or "the answer has no body"
