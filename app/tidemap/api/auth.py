"""Who asks, and may they: bearer keys and browser sessions, too many requests."""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from fastapi import Request
from sqlalchemy.exc import SQLAlchemyError
from starlette.concurrency import run_in_threadpool
from starlette.requests import HTTPConnection

from tidemap.api.limits import Limits, Senders
from tidemap.api.origins import refuse_other_sites, refuse_strangers
from tidemap.api.scopes import check_scope
from tidemap.api.state import state_of
from tidemap.errors import DomainError, ForbiddenError, KeyChangedError, OtherSiteError, UnauthorizedError
from tidemap.services.context import Context
from tidemap.services.keys import (
    OPEN,
    Claim,
    Principal,
    Role,
    allows,
    by_secret,
    by_session,
    digest_of,
    is_open,
    note_use,
)
from tidemap.settings import Settings, is_loopback

Answer = TypeVar("Answer")
COOKIE = "tidemap_session"
RECHECK_S = 2.0
SHARED_S = 1.0
"""How old a check of a key may be that sockets share."""
ENDED = (4401, "the key or session has ended; sign in again")


def authenticate(connection: HTTPConnection) -> Principal:
    """Who opened this request or socket; asked again of the same one, it is neither looked up nor counted again.

    Raises UnauthorizedError when keys exist and none is given, OtherSiteError, RateLimitError.
    """
    known = getattr(connection.state, "principal", None)
    if isinstance(known, Principal):
        return known
    principal = _principal(connection)
    _count(connection, principal)
    connection.state.principal = principal
    return principal


def readmit(connection: HTTPConnection, principal: Principal) -> None:
    """Count a request of somebody whom `authenticate` has found before, and of whom nothing stored has changed since.

    Raises UnauthorizedError where the key has expired, OtherSiteError, RateLimitError.
    """
    if _is_over(connection, principal):
        raise UnauthorizedError("This key has expired. Ask an admin for a new one.")
    if principal.key_id is None:
        refuse_strangers(connection)
    _count(connection, principal)


def require(role: Role) -> Callable[[Request], Principal]:
    """A dependency: who asks, if their role allows what `role` may and what the path names is in their scope.

    Who may see some locations only may do nothing at a path that names none: that is for all of them.
    """

    def check(request: Request) -> Principal:
        principal = authenticate(request)
        _check_role(principal, role)
        check_scope(request, principal)
        return principal

    return check


def require_filtering(role: Role) -> Callable[[Request], Principal]:
    """A dependency as `require`, of a route that itself shows only what is in the scope of who asks."""

    def check(request: Request) -> Principal:
        principal = authenticate(request)
        _check_role(principal, role)
        return principal

    return check


async def until_ended(connection: HTTPConnection) -> None:
    """Ends soon after the key or session that opened a socket does: revoked, expired or signed out, on any server.

    Asks the database every RECHECK_S; while that fails the socket stays.
    """
    opened_by = await run_in_threadpool(authenticate, connection)
    while True:
        await asyncio.sleep(RECHECK_S)
        try:
            if await _shared_check(connection) != opened_by:
                return
        except (UnauthorizedError, OtherSiteError):
            return
        except (DomainError, SQLAlchemyError):
            continue


async def _shared_check(connection: HTTPConnection) -> Principal:
    """As `_look_up`, once for all sockets that were opened with the same key or session."""
    key_checks = state_of(connection).key_checks
    sent = bearer(connection), connection.cookies.get(COOKIE)
    if (task := key_checks.get(sent)) is None:
        task = key_checks[sent] = asyncio.create_task(run_in_threadpool(_look_up, connection))
        # The socket that asked may be closed when it fails.
        task.add_done_callback(lambda ended: ended.cancelled() or ended.exception())
        asyncio.get_running_loop().call_later(SHARED_S, key_checks.pop, sent, None)
    return await asyncio.shield(task)


def _look_up(connection: HTTPConnection) -> Principal:
    """Who holds what a connection sent, as it is now; not counted. Raises UnauthorizedError."""
    ctx = state_of(connection).ctx
    secret = bearer(connection)
    if secret is not None:
        return by_secret(ctx, secret)
    return OPEN if is_open(ctx) else by_session(ctx, connection.cookies.get(COOKIE, ""))


def _is_over(connection: HTTPConnection, principal: Principal) -> bool:
    """Whether a key has expired."""
    ctx: Context = state_of(connection).ctx
    return principal.expires_at is not None and principal.expires_at <= ctx.clock()


def _check_role(principal: Principal, role: Role) -> None:
    if not allows(principal.role, role):
        raise ForbiddenError(f"The key {principal.name!r} has role {principal.role}; this needs {role} or admin.")


def _count(connection: HTTPConnection, principal: Principal) -> None:
    """Count a request. Raises RateLimitError."""
    if principal.key_id is not None:
        _limits(connection).requests.take(f"key {principal.key_id}")
        if _limits(connection).uses.due(principal.key_id):
            note_use(state_of(connection).ctx, principal.key_id)
    elif not is_loopback(_settings(connection).host):
        _limits(connection).requests.take(_address(connection))


@dataclass(frozen=True, slots=True)
class Admission:
    """Who posts or asks; `claim` is to be confirmed where the database is read."""

    principal: Principal
    claim: Claim | None


def require_sender(role: Role) -> Callable[[Request], Coroutine[Any, Any, Admission]]:
    """A dependency: who posts or asks, if their role allows what `role` may.

    A key that did lately is looked up where the database is read anyway, not here. Raises as `authenticate`,
    ForbiddenError.
    """

    async def check(request: Request) -> Admission:
        secret = bearer(request)
        digest = None if secret is None else digest_of(secret)
        claim = None if digest is None and COOKIE in request.cookies else _senders(request).get(digest)
        if claim is None or _is_over(request, claim.principal):
            principal = await run_in_threadpool(authenticate, request)
            if digest is not None or principal == OPEN:
                claim = Claim(principal, digest)
                _senders(request).add(claim)
        else:
            principal = claim.principal
            if digest is None:
                refuse_strangers(request)
            _count(request, principal)
        _check_role(principal, role)
        check_scope(request, principal)
        return Admission(principal, claim)

    return check


async def confirming(request: Request, sender: Admission, answer: Awaitable[Answer]) -> Answer:
    """An answer whose maker confirms the sender's claim; one that turns out untrue is refused.

    Raises UnauthorizedError, RateLimitError.
    """
    try:
        return await answer
    except UnauthorizedError:
        if sender.claim is not None:
            await _refuse(request, sender.claim)
        raise


async def _refuse(request: Request, claim: Claim) -> None:
    """Refuse a claim that is not true any more, counting what its sender sent as every wrong key.

    Raises UnauthorizedError, RateLimitError, KeyChangedError where the key is valid all the same.
    """
    _senders(request).forget(claim)
    if await run_in_threadpool(authenticate, request) != OPEN:
        raise KeyChangedError


@contextmanager
def counting_wrong_keys(connection: HTTPConnection, secret: str) -> Iterator[None]:
    """Counts a secret that is found wrong within. Raises RateLimitError when too many came from its address."""
    limits, address = _limits(connection), _address(connection)
    if secret not in limits.right_keys:
        limits.wrong_keys.check(address)
    try:
        yield
    except UnauthorizedError:
        limits.wrong_keys.spend(address)
        raise
    limits.right_keys.add(secret)


def _principal(connection: HTTPConnection) -> Principal:
    ctx: Context = state_of(connection).ctx
    secret = bearer(connection)
    if secret is not None:
        with counting_wrong_keys(connection, secret):
            return by_secret(ctx, secret)
    if is_open(ctx):
        refuse_strangers(connection)
        return OPEN
    if COOKIE in connection.cookies:
        refuse_other_sites(connection)
        token = connection.cookies[COOKIE]
        with counting_wrong_keys(connection, token):
            return by_session(ctx, token)
    raise UnauthorizedError("Send a key: 'Authorization: Bearer tm_…'. An admin makes keys with 'tidemap keys create'.")


def bearer(connection: HTTPConnection) -> str | None:
    """The secret that is sent as a header, None without one."""
    scheme, _, secret = connection.headers.get("authorization", "").partition(" ")
    return secret.strip() if secret and scheme.lower() == "bearer" else None


def _address(connection: HTTPConnection) -> str:
    return connection.client.host if connection.client else ""


def _limits(connection: HTTPConnection) -> Limits:
    limits: Limits = state_of(connection).limits
    return limits


def _senders(connection: HTTPConnection) -> Senders:
    senders: Senders = state_of(connection).senders
    return senders


def _settings(connection: HTTPConnection) -> Settings:
    ctx: Context = state_of(connection).ctx
    return ctx.settings
