"""The repository of API keys."""

from sqlalchemy import Connection, bindparam, delete, func, insert, select

from tidemap.errors import KeyNotFoundError
from tidemap.storage.records import KeyRecord
from tidemap.storage.tables import api_key

# What every request asks, built once: building it takes longer than running it.
_BY_HASH = select(api_key).where(api_key.c.hash == bindparam("hash"))
_ANY = select(api_key.c.id).limit(1)


class Keys:
    """Keys by the hash of their secret."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def create(self, name: str, role: str, prefix: str, digest: bytes, now: float) -> KeyRecord:
        """Store a new key."""
        values = {"name": name, "role": role, "prefix": prefix, "hash": digest, "created_at": now}
        self._connection.execute(insert(api_key).values(**values))
        found = self.find(digest)
        if found is None:
            raise KeyNotFoundError(name)
        return found

    def find(self, digest: bytes) -> KeyRecord | None:
        """The key whose secret has this hash."""
        row = self._connection.execute(_BY_HASH, {"hash": digest}).mappings().first()
        return None if row is None else KeyRecord(**row)

    def get(self, key_id: int) -> KeyRecord | None:
        """The key with this id."""
        row = self._connection.execute(select(api_key).where(api_key.c.id == key_id)).mappings().first()
        return None if row is None else KeyRecord(**row)

    def list(self, after: int | None, limit: int | None) -> list[KeyRecord]:
        """In order of creation; `after` is the last id of the page before, None for `limit` is all."""
        query = select(api_key).order_by(api_key.c.id).limit(limit)
        if after is not None:
            query = query.where(api_key.c.id > after)
        return [KeyRecord(**row) for row in self._connection.execute(query).mappings()]

    def count(self) -> int:
        """How many keys there are."""
        return int(self._connection.execute(select(func.count()).select_from(api_key)).scalar_one())

    def none(self) -> bool:
        """Whether there is no key."""
        return self._connection.execute(_ANY).first() is None

    def delete(self, key_id: int) -> None:
        """Raises KeyNotFoundError."""
        if self._connection.execute(delete(api_key).where(api_key.c.id == key_id)).rowcount == 0:
            raise KeyNotFoundError(key_id)
