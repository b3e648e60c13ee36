"""Fencing tokens: the numbers of leader terms. What belongs to an earlier term than the latest is not stored."""

from sqlalchemy import Connection, select

from tidemap.errors import NotLeaderError
from tidemap.storage.counters import take
from tidemap.storage.tables import counter

_NAME = "background"
# Shared, so that a term begins only after the writes under way that were confirmed for the one before.
_CURRENT = select(counter.c.value).where(counter.c.name == _NAME).with_for_update(read=True)


class FencingTokens:
    """The numbers of terms, which grow."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def begin(self) -> int:
        """The number of a new term, in which all earlier ones have ended."""
        return take(self._connection, _NAME)

    def confirm(self, number: int) -> None:
        """Raises NotLeaderError where a later term has begun; otherwise none does before this transaction has ended."""
        if self._connection.execute(_CURRENT).scalar() != number:
            raise NotLeaderError
