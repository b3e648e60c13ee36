"""The repository of mutes: when nobody is to hear of the events of some locations."""

import builtins
from typing import Any

from sqlalchemy import Connection, delete, func, insert, select

from tidemap.errors import MuteNotFoundError
from tidemap.scope import Scope
from tidemap.storage.counters import take
from tidemap.storage.records import MuteRecord
from tidemap.storage.tables import mute


class MuteRepository:
    """Mutes in order of creation."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def create(self, values: dict[str, Any]) -> MuteRecord:
        """Store a new one."""
        number = take(self._connection, "mute")
        self._connection.execute(insert(mute).values(id=number, **values))
        return self.get(number)

    def get(self, mute_id: int) -> MuteRecord:
        """Raises MuteNotFoundError."""
        row = self._connection.execute(select(mute).where(mute.c.id == mute_id)).mappings().first()
        if row is None:
            raise MuteNotFoundError(mute_id)
        return _record(row)

    def list(self, after: int | None = None, limit: int | None = None) -> builtins.list[MuteRecord]:
        """In order of creation; `after` is the last id of the page before."""
        query = select(mute).order_by(mute.c.id).limit(limit)
        if after is not None:
            query = query.where(mute.c.id > after)
        return [_record(row) for row in self._connection.execute(query).mappings()]

    def count(self) -> int:
        """How many there are."""
        return int(self._connection.execute(select(func.count()).select_from(mute)).scalar_one())

    def delete(self, mute_id: int) -> None:
        """Raises MuteNotFoundError."""
        if not self._connection.execute(delete(mute).where(mute.c.id == mute_id)).rowcount:
            raise MuteNotFoundError(mute_id)


def _record(row: Any) -> MuteRecord:
    values = {name: value for name, value in row.items() if name != "locations"}
    return MuteRecord(**values, scope=Scope.loaded(row["locations"]))
