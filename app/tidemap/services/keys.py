"""Keys: making, checking and revoking them. Secrets are random, so a plain hash of them is enough."""

import hashlib
import math
import secrets
from contextlib import suppress
from dataclasses import dataclass, field, fields
from typing import Literal, get_args

from tidemap.errors import BusyError, InvalidInputError, KeyEndsError, KeyNotFoundError, UnauthorizedError
from tidemap.scope import EVERYWHERE, Scope
from tidemap.services.context import Context
from tidemap.storage.records import KeyRecord
from tidemap.storage.work import Work

PREFIX = "tm_"
SESSION_S = 12 * 3600.0
"""How long a browser stays signed in."""
MAX_OVERLAP_S = 90 * 86400.0
"""How long a rotated key may still open."""
Role = Literal["robot", "operator", "admin"]
ROLES: tuple[Role, ...] = get_args(Role)


@dataclass(frozen=True, slots=True)
class Principal:
    """Who asks: a key, or anybody on an open server. Two are the same whenever their key ends."""

    name: str
    role: Role
    key_id: int | None
    scope: Scope = EVERYWHERE
    expires_at: float | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class IssuedKey(KeyRecord):
    """A new key with its secret `key`, which is not kept."""

    key: str


OPEN = Principal("anybody", "admin", None)


@dataclass(frozen=True, slots=True)
class Claim:
    """Who a secret stood for when it was looked up last, by its hash; without one, anybody on an open server."""

    principal: Principal
    digest: bytes | None


def create_key(
    ctx: Context, name: str, role: Role, scope: Scope = EVERYWHERE, expires_at: float | None = None
) -> IssuedKey:
    """A new key with its secret. Raises InvalidInputError when it would have expired already."""
    if expires_at is not None and expires_at <= ctx.clock():
        raise InvalidInputError.at("expires_at", "it is over already; give a later time")
    return ctx.store.write(lambda work: _issue(ctx, work, name, role, scope, expires_at))


def rotate_key(ctx: Context, key_id: int, overlap_s: float) -> IssuedKey:
    """Another key like this one, with the same expiry; this one expires after `overlap_s`, 0 to MAX_OVERLAP_S seconds.

    One that was rotated before, or expires within the overlap, is refused: a new key would expire with it, as it does
    now, and not as it was meant to. Raises KeyNotFoundError, KeyEndsError, InvalidInputError.
    """
    if not (math.isfinite(overlap_s) and 0 <= overlap_s <= MAX_OVERLAP_S):
        raise InvalidInputError.at("overlap_s", f"give 0 to {MAX_OVERLAP_S:.0f} seconds")

    def rotate(work: Work) -> IssuedKey:
        old, now = work.keys.get(key_id), ctx.clock()
        if old.expired(now):
            raise KeyNotFoundError(key_id)
        if old.rotated or (old.expires_at is not None and old.expires_at <= now + overlap_s):
            raise KeyEndsError(key_id)
        work.keys.rotate(key_id, now + overlap_s)
        return _issue(ctx, work, old.name, _role(old), old.scope, old.expires_at)

    return ctx.store.write(rotate)


def note_use(ctx: Context, key_id: int) -> None:
    """Note that a key is used now; nobody waits for it."""
    now = ctx.clock()
    with suppress(BusyError):
        ctx.store.submit(lambda work: work.keys.used(key_id, now))


def _issue(ctx: Context, work: Work, name: str, role: Role, scope: Scope, expires_at: float | None) -> IssuedKey:
    secret = PREFIX + secrets.token_urlsafe(32)
    record = work.keys.create(name, role, secret[:8], digest_of(secret), ctx.clock(), scope, expires_at)
    return IssuedKey(**{each.name: getattr(record, each.name) for each in fields(record)}, key=secret)


def list_keys(ctx: Context, after: int | None = None, limit: int | None = None) -> list[KeyRecord]:
    """In order of creation; `after` is the last id of the page before."""
    with ctx.store.read() as work:
        return work.keys.list(after, limit)


def delete_key(ctx: Context, key_id: int) -> None:
    """Revoke a key. Raises KeyNotFoundError."""
    ctx.store.write(lambda work: work.keys.delete(key_id))


def is_open(ctx: Context) -> bool:
    """Whether everybody who reaches the server may do everything: no key exists, and none is needed to listen here."""
    if not ctx.settings.keyless:
        return False
    with ctx.store.read() as work:
        return work.keys.none()


def confirm(work: Work, claim: Claim) -> None:
    """Raises UnauthorizedError where a claim is not true any more: the key is revoked, or now there is one."""
    if claim.digest is None:
        true = work.keys.none()
    else:
        record = work.keys.find(claim.digest)
        known = None if record is None else principal_of(record)
        true = known is not None and known == claim.principal and known.expires_at == claim.principal.expires_at
    if not true:
        raise UnauthorizedError("This key is not known any more. Ask an admin for a new one.")


def by_secret(ctx: Context, secret: str) -> Principal:
    """Who holds a secret. Raises UnauthorizedError."""
    with ctx.store.read() as work:
        record = work.keys.find(digest_of(secret))
    return principal_of(_valid(record, ctx.clock()))


def start_session(ctx: Context, secret: str) -> str:
    """A random token that stands for the key in a browser for SESSION_S; its hash is stored.

    Raises UnauthorizedError.
    """
    token = secrets.token_urlsafe(32)

    def start(work: Work) -> None:
        now = ctx.clock()
        record = _valid(work.keys.find(digest_of(secret)), now)
        work.keys.add_session(record.id, digest_of(token), now, now + SESSION_S)

    ctx.store.write(start)
    return token


def by_session(ctx: Context, token: str) -> Principal:
    """Who holds a session token. Raises UnauthorizedError when it is unknown or has ended."""
    with ctx.store.read() as work:
        record = work.keys.find_session(digest_of(token), ctx.clock())
    if record is None or record.expired(ctx.clock()):
        raise UnauthorizedError("This session has ended. Sign in again.")
    return principal_of(record)


def end_session(ctx: Context, token: str) -> None:
    """Sign a browser out; its token opens nothing from now on, on no server of this database."""
    ctx.store.write(lambda work: work.keys.delete_session(digest_of(token)))


def allows(role: Role, needed: Role) -> bool:
    """Whether a role may do what `needed` may: admins everything, robots and operators each their own."""
    return role in {needed, "admin"}


def digest_of(secret: str) -> bytes:
    """What is kept of a secret."""
    return hashlib.sha256(secret.encode()).digest()


def principal_of(record: KeyRecord) -> Principal:
    """Who holds a key."""
    return Principal(record.name, _role(record), record.id, record.scope, record.expires_at)


def _valid(record: KeyRecord | None, now: float) -> KeyRecord:
    """A key that was found, if it opens anything. Raises UnauthorizedError."""
    if record is None:
        raise UnauthorizedError("This key is not known. Check it, or ask an admin for a new one.")
    if record.expired(now):
        raise UnauthorizedError("This key has expired. Ask an admin for a new one.")
    return record


def _role(record: KeyRecord) -> Role:
    return next(role for role in ROLES if role == record.role)
