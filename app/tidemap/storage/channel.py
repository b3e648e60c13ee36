"""The channel: short texts from each process on a PostgreSQL database to all others, by LISTEN and NOTIFY."""

from collections.abc import Sequence
from typing import Any

import psycopg
from sqlalchemy import make_url

from tidemap.errors import StorageUnavailableError

MAX_TEXT_BYTES = 7999
"""What PostgreSQL takes in one notification."""
CONNECT_S = 5
GIVEN_UP_S = 15
"""How long a network may be silent about what was sent before its connection is given up."""
# The number of a table is part of the name, so that two schemas of one database do not share it.
_NAME = "SELECT 'tidemap_' || CAST(CAST('counter' AS regclass) AS oid)"
_SEND = "SELECT pg_notify(%s, text) FROM unnest(%s::text[]) AS text"


class Channel:
    """A connection of its own, opened when it is needed and again after it was lost. Use it in one thread.

    A listener hears its own process's texts too, and none that is sent while it has no connection.
    """

    def __init__(self, url: str) -> None:
        address = make_url(url)
        timeouts = {"connect_timeout": CONNECT_S, "tcp_user_timeout": GIVEN_UP_S * 1000}
        _, how = address.get_dialect()().create_connect_args(address)
        self._how: dict[str, Any] = {**how, **timeouts}
        self._connection: psycopg.Connection[Any] | None = None
        self._name = ""
        self._listens = False

    @property
    def listens(self) -> bool:
        """Whether it has heard all that was sent since its first call."""
        return self._listens

    def listen(self, seconds: float) -> list[str]:
        """What was sent since the last call; waits so long for something. Raises StorageUnavailableError."""
        try:
            connection = self._connected()
            if not self._listens:
                connection.execute(f"LISTEN {self._name}")
                self._listens = True
            return [notify.payload for notify in connection.notifies(timeout=seconds, stop_after=1)]
        except psycopg.Error as error:
            raise self._lost() from error

    def send(self, texts: Sequence[str]) -> None:
        """Send texts of at most MAX_TEXT_BYTES each. Raises StorageUnavailableError, and has sent none then."""
        try:
            connection = self._connected()
            connection.execute(_SEND, (self._name, list(texts)))
        except psycopg.Error as error:
            raise self._lost() from error

    def close(self) -> None:
        """Let go of the connection."""
        if self._connection is not None:
            self._connection.close()
            self._connection, self._listens = None, False

    def _connected(self) -> "psycopg.Connection[Any]":
        if self._connection is None:
            connection = psycopg.connect(**self._how, autocommit=True)
            (self._name,) = connection.execute(_NAME).fetchone() or ("",)
            self._connection = connection
        return self._connection

    def _lost(self) -> StorageUnavailableError:
        self.close()
        return StorageUnavailableError()
