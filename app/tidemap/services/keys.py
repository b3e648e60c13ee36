"""Keys: making, checking and revoking them. Secrets are random, so a plain hash of them is enough."""

import hashlib
import secrets
from dataclasses import asdict, dataclass
from typing import Literal, get_args

from tidemap.errors import UnauthorizedError
from tidemap.services.context import Context
from tidemap.storage.records import KeyRecord
from tidemap.storage.work import Work

PREFIX = "tm_"
SESSION_S = 12 * 3600.0
"""How long a browser stays signed in."""
Role = Literal["robot", "operator", "admin"]
ROLES: tuple[Role, ...] = get_args(Role)


@dataclass(frozen=True, slots=True)
class Principal:
    """Who asks: a key, or anybody on an open server."""

    name: str
    role: Role
    key_id: int | None


@dataclass(frozen=True)
class IssuedKey(KeyRecord):
    """A new key with its secret `key`, which is not kept."""

    key: str


OPEN = Principal("anybody", "admin", None)


@dataclass(frozen=True, slots=True)
class Claim:
    """Who a secret stood for when it was looked up last, by its hash; without one, anybody on an open server."""

    principal: Principal
    digest: bytes | None


def create_key(ctx: Context, name: str, role: Role) -> IssuedKey:
    """A new key with its secret."""
    secret = PREFIX + secrets.token_urlsafe(32)
    record = ctx.store.write(lambda work: work.keys.create(name, role, secret[:8], digest_of(secret), ctx.clock()))
    return IssuedKey(**asdict(record), key=secret)


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
        true = record is not None and _principal(record) == claim.principal
    if not true:
        raise UnauthorizedError("This key is not known any more. Ask an admin for a new one.")


def by_secret(ctx: Context, secret: str) -> Principal:
    """Who holds a secret. Raises UnauthorizedError."""
    with ctx.store.read() as work:
        record = work.keys.find(digest_of(secret))
    if record is None:
        raise UnauthorizedError("This key is not known. Check it, or ask an admin for a new one.")
    return _principal(record)


def start_session(ctx: Context, secret: str) -> str:
    """A random token that stands for the key in a browser for SESSION_S; its hash is stored.

    Raises UnauthorizedError.
    """
    token = secrets.token_urlsafe(32)

    def start(work: Work) -> None:
        record, now = work.keys.find(digest_of(secret)), ctx.clock()
        if record is None:
            raise UnauthorizedError("This key is not known. Check it, or ask an admin for a new one.")
        work.keys.add_session(record.id, digest_of(token), now, now + SESSION_S)

    ctx.store.write(start)
    return token


def by_session(ctx: Context, token: str) -> Principal:
    """Who holds a session token. Raises UnauthorizedError when it is unknown or has ended."""
    with ctx.store.read() as work:
        record = work.keys.find_session(digest_of(token), ctx.clock())
    if record is None:
        raise UnauthorizedError("This session has ended. Sign in again.")
    return _principal(record)


def end_session(ctx: Context, token: str) -> None:
    """Sign a browser out; its token opens nothing from now on, on no server of this database."""
    ctx.store.write(lambda work: work.keys.delete_session(digest_of(token)))


def allows(role: Role, needed: Role) -> bool:
    """Whether a role may do what `needed` may: admins everything, robots and operators each their own."""
    return role in {needed, "admin"}


def digest_of(secret: str) -> bytes:
    """What is kept of a secret."""
    return hashlib.sha256(secret.encode()).digest()


def _principal(record: KeyRecord) -> Principal:
    role: Role = next(role for role in ROLES if role == record.role)
    return Principal(record.name, role, record.id)
