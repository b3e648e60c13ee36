"""Pages behind the guard: who may not look is led to the sign-in, and what is wrong is said on a page too."""

from collections.abc import Callable
from typing import Any

from fastapi import Request, Response

from tidemap.errors import DomainError
from tidemap.services.context import Context
from tidemap.services.keys import OPEN
from tidemap_web.pages import guard
from tidemap_web.pages.problems import problem_page
from tidemap_web.pages.templates import page

Facts = dict[str, Any]


def guarded(ctx: Context, request: Request, template: str, facts: Callable[[], Facts]) -> Response:
    """The page for who may look."""
    try:
        if redirected := guard.redirect(request):
            return redirected
        return page(request, template, {**guard.header(ctx, request), **facts()})
    except DomainError as error:
        return problem_page(request, error)


def origin(request: Request) -> Facts:
    """What examples need: the server's address, and whether it wants a key."""
    return {"origin": str(request.base_url).rstrip("/"), "keyed": guard.principal(request) != OPEN}
