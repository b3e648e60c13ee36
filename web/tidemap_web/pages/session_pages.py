"""Signing in and out."""

from fastapi import APIRouter, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse

from tidemap.errors import DomainError, UnauthorizedError
from tidemap.services.context import Context
from tidemap_web.pages import guard
from tidemap_web.pages.problems import Refusal, problem_page, refusal_of
from tidemap_web.pages.sign_in import sign_in_form
from tidemap_web.pages.templates import page


def router(ctx: Context) -> APIRouter:
    """The form, and what it and the button of every page do."""
    routes = APIRouter(include_in_schema=False)

    @routes.get("/login", response_model=None)
    def login(request: Request, next: str = "/") -> Response:
        """The form that asks for a key; who needs none goes straight on."""
        try:
            if guard.refuse(request) is None:
                return RedirectResponse(guard.local(next), 303, guard.NO_STORE)
            return _form(ctx, request, next)
        except DomainError as error:
            return problem_page(request, error)

    @routes.post("/login", response_model=None)
    async def sign_in(request: Request) -> Response:
        """Take a key and remember the browser. Whatever is wrong is said on the form."""
        then = "/"
        try:
            sent = await sign_in_form(request)
            then = guard.local(sent.next)
            return await run_in_threadpool(guard.sign_in, ctx, request, sent.key, then)
        except UnauthorizedError:
            problem = "This key is not known here. Check that all of it was copied."
            return await run_in_threadpool(_form, ctx, request, then, Refusal(401, problem))
        except DomainError as error:
            return await run_in_threadpool(_form, ctx, request, then, refusal_of(error))

    @routes.post("/logout", response_model=None)
    def sign_out(request: Request) -> Response:
        """End the browser's session."""
        try:
            return guard.sign_out(ctx, request)
        except DomainError as error:
            return problem_page(request, error)

    return routes


def _form(ctx: Context, request: Request, then: str, refusal: Refusal | None = None) -> Response:
    problem = None if refusal is None else refusal.detail
    facts = {**guard.header(ctx, request), "next": guard.local(then), "problem": problem}
    answer = page(request, "login.html", facts, status=200 if refusal is None else refusal.status)
    if refusal is not None:
        answer.headers.update(refusal.headers)
    return answer
