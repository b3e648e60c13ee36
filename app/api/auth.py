"""Who asks, and may they: bearer keys and browser sessions."""

from collections.abc import Callable, Mapping

from fastapi import Request
from starlette.requests import HTTPConnection

from app.errors import ForbiddenError, UnauthorizedError
from app.schemas.keys import Role
from app.services.context import Context
from app.services.keys import OPEN, Principal, allows, by_secret, by_session, is_open

COOKIE = "tidemap_session"


def principal_of(ctx: Context, headers: Mapping[str, str], cookies: Mapping[str, str]) -> Principal:
    """Who sends these headers and cookies. Raises UnauthorizedError when keys exist and none is given."""
    scheme, _, secret = headers.get("authorization", "").partition(" ")
    if secret and scheme.lower() == "bearer":
        return by_secret(ctx, secret.strip())
    if is_open(ctx):
        return OPEN
    if COOKIE in cookies:
        return by_session(ctx, cookies[COOKIE])
    raise UnauthorizedError("Send a key: 'Authorization: Bearer tm_…'. An admin makes keys with 'tidemap keys create'.")


def of_connection(connection: HTTPConnection) -> Principal:
    """Who opened this request or socket. Raises UnauthorizedError."""
    ctx: Context = connection.app.state.ctx
    return principal_of(ctx, connection.headers, connection.cookies)


def require(role: Role) -> Callable[[Request], Principal]:
    """A dependency: who asks, if their role allows what `role` may."""

    def check(request: Request) -> Principal:
        principal = of_connection(request)
        if not allows(principal.role, role):
            raise ForbiddenError(f"The key {principal.name!r} has role {principal.role}; this needs {role} or admin.")
        return principal

    return check
