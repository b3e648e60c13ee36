"""What goes wrong, as a page for people."""

from collections.abc import Awaitable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus

from fastapi import FastAPI, Request, Response
from starlette.exceptions import HTTPException

from tidemap.api.errors import STATUS, headers_of, look_up
from tidemap.errors import DomainError
from tidemap_web.pages.templates import page


@dataclass(frozen=True, slots=True)
class Refusal:
    """A status, what to say, and the headers that go with it."""

    status: int
    detail: str
    headers: Mapping[str, str] = field(default_factory=dict)


def refusal_of(error: DomainError) -> Refusal:
    """The refusal that the API would answer with a problem document."""
    return Refusal(look_up(STATUS, error, 500), str(error), headers_of(error))


def problem_page(request: Request, error: DomainError) -> Response:
    """A page that says what is wrong. It asks nothing of who is signed in, for that may be what is wrong."""
    refusal = refusal_of(error)
    facts = {"title": error.title, "detail": refusal.detail, "signed_in": None, "has_viewer": False, "now": 0}
    answer = page(request, "problem.html", facts, status=refusal.status)
    answer.headers.update(refusal.headers)
    return answer


def install(site: FastAPI) -> None:
    """Have addresses that people mistyped answer with a page; what asks for the API gets its problem documents."""
    documents = site.exception_handlers[HTTPException]

    def answer(request: Request, error: Exception) -> Response | Awaitable[Response]:
        if not isinstance(error, HTTPException) or not _is_for_people(request):
            return documents(request, error)
        title = HTTPStatus(error.status_code).phrase
        detail = (
            _NOT_HERE if error.status_code == HTTPStatus.NOT_FOUND else f"{title}: {request.method} is not done here."
        )
        facts = {"title": title.capitalize(), "detail": detail, "signed_in": None, "has_viewer": False, "now": 0}
        made = page(request, "problem.html", facts, status=error.status_code)
        made.headers.update(error.headers or {})
        return made

    site.add_exception_handler(HTTPException, answer)


_NOT_HERE = "There is no page at this address. It may have been mistyped, or what it showed was deleted or renamed."


def _is_for_people(request: Request) -> bool:
    """Whether a browser asked for a page."""
    return not request.url.path.startswith("/api/") and "text/html" in request.headers.get("accept", "")
