"""The repository of API keys."""

from typing import Any

from sqlalchemy import Connection, RowMapping, bindparam, delete, func, insert, select, update

from tidemap.errors import KeyNotFoundError
from tidemap.scope import EVERYWHERE, Scope
from tidemap.storage.changes import UNCOUNTED
from tidemap.storage.records import KeyRecord
from tidemap.storage.tables import api_key, session

MAX_SESSIONS = 100
"""Most sessions of one key."""

# What every request asks, built once: building it takes longer than running it.
_BY_HASH = select(api_key).where(api_key.c.hash == bindparam("hash"))
_BY_SESSION = (
    select(api_key)
    .join(session, session.c.key_id == api_key.c.id)
    .where(session.c.hash == bindparam("hash"), session.c.expires_at > bindparam("now"))
)
_ANY = select(api_key.c.id).limit(1)


class KeyRepository:
    """Keys by the hash of their secret."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def create(
        self,
        name: str,
        role: str,
        prefix: str,
        digest: bytes,
        now: float,
        scope: Scope = EVERYWHERE,
        expires_at: float | None = None,
    ) -> KeyRecord:
        """Store a new key."""
        values: dict[str, Any] = {"name": name, "role": role, "prefix": prefix, "hash": digest, "created_at": now}
        values |= {"locations": scope.dumped(), "expires_at": expires_at}
        self._connection.execute(insert(api_key).values(**values))
        found = self.find(digest)
        if found is None:
            raise KeyNotFoundError(name)
        return found

    def get(self, key_id: int) -> KeyRecord:
        """Raises KeyNotFoundError."""
        row = self._connection.execute(select(api_key).where(api_key.c.id == key_id)).mappings().first()
        if row is None:
            raise KeyNotFoundError(key_id)
        return _record(row)

    def rotate(self, key_id: int, expires_at: float) -> None:
        """Let a key expire then, as another one is made in its place."""
        values = {"expires_at": expires_at, "rotated": True}
        self._connection.execute(update(api_key).where(api_key.c.id == key_id).values(**values))

    def used(self, key_id: int, at: float) -> None:
        """Note that a key was used."""
        query = update(api_key).where(api_key.c.id == key_id).values(last_used_at=at)
        self._connection.execute(query.execution_options(**UNCOUNTED))

    def find(self, digest: bytes) -> KeyRecord | None:
        """The key whose secret has this hash."""
        row = self._connection.execute(_BY_HASH, {"hash": digest}).mappings().first()
        return None if row is None else _record(row)

    def find_session(self, digest: bytes, now: float) -> KeyRecord | None:
        """The key of the session whose token has this hash, None when the session has ended by `now`."""
        row = self._connection.execute(_BY_SESSION, {"hash": digest, "now": now}).mappings().first()
        return None if row is None else _record(row)

    def add_session(self, key_id: int, digest: bytes, now: float, expires_at: float) -> None:
        """Store a session; those that have expired by `now` and the key's oldest above MAX_SESSIONS go."""
        self._connection.execute(delete(session).where(session.c.expires_at <= now))
        of_key = select(session.c.hash).where(session.c.key_id == key_id)
        newest_first = of_key.order_by(session.c.expires_at.desc(), session.c.hash)
        old = self._connection.execute(newest_first.offset(MAX_SESSIONS - 1)).scalars().all()
        self._connection.execute(delete(session).where(session.c.hash.in_(old)))
        self._connection.execute(insert(session).values(hash=digest, key_id=key_id, expires_at=expires_at))

    def delete_session(self, digest: bytes) -> None:
        """End a session; one that is not there has ended."""
        self._connection.execute(delete(session).where(session.c.hash == digest))

    def list(self, after: int | None, limit: int | None) -> list[KeyRecord]:
        """In order of creation; `after` is the last id of the page before, None for `limit` is all."""
        query = select(api_key).order_by(api_key.c.id).limit(limit)
        if after is not None:
            query = query.where(api_key.c.id > after)
        return [_record(row) for row in self._connection.execute(query).mappings()]

    def count(self) -> int:
        """How many keys there are."""
        return int(self._connection.execute(select(func.count()).select_from(api_key)).scalar_one())

    def none(self) -> bool:
        """Whether there is no key."""
        return self._connection.execute(_ANY).first() is None

    def delete(self, key_id: int) -> None:
        """Delete a key and its sessions. Raises KeyNotFoundError."""
        self._connection.execute(delete(session).where(session.c.key_id == key_id))
        if self._connection.execute(delete(api_key).where(api_key.c.id == key_id)).rowcount == 0:
            raise KeyNotFoundError(key_id)


def _record(row: RowMapping) -> KeyRecord:
    values = {name: value for name, value in row.items() if name != "locations"}
    return KeyRecord(**values, scope=Scope.loaded(row["locations"]))
