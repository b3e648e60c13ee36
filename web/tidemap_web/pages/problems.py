"""What goes wrong, as a page for people."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from fastapi import Request, Response

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
    facts = {"title": error.title, "detail": refusal.detail, "signed_in": None, "has_viewer": False}
    answer = page(request, "problem.html", facts, status=refusal.status)
    answer.headers.update(refusal.headers)
    return answer
