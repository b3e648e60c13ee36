"""The stream of messages of the server: where to connect, what was read, when to give up. No sockets here."""

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias
from urllib.parse import urlencode

from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException

from tidemap.client.address import address
from tidemap.client.errors import TidemapError, UnreachableError, problem
from tidemap.client.requests import present
from tidemap.client.retry import REFUSED, RetryPolicy
from tidemap.client.transport import Server
from tidemap.schemas.common import parse_time

MessageKind: TypeAlias = Literal["observation", "anomaly", "update", "job", "location", "attention"]
BROKEN = (WebSocketException, OSError)
"""What a WebSocket may break with."""
POLICY = 1008
HELD_S = 0.5
"""A connection that held so long begins the pauses anew; one that ends at once is tried again ever more rarely."""
PRIVATE = range(4400, 4500)
"""Close codes 4000 + an HTTP status: the request itself is wrong, so asking again does not help."""
POSITION = "Last-Event-ID"
"""The header of a server's answer that names the last change of an anomaly before the first message."""


@dataclass(frozen=True, slots=True)
class Message:
    """Something happened: `time` in Unix seconds, `data` the message as it was sent, these four included."""

    kind: str
    location: str
    id: int | None
    time: float
    data: Mapping[str, Any]


class Feed:
    """A subscription that survives its connections.

    It knows the last change of an anomaly seen, or before the first message the last one there was, and resumes behind
    it.
    """

    def __init__(
        self,
        server: Server,
        retry: RetryPolicy,
        location: str | None,
        kind: MessageKind | None,
        after: str | int | None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._url = server.base.replace("http", "ws", 1)
        self._headers = server.headers
        self._query = present(location=location, kind=kind, after=after)
        self._retry = retry
        self._clock = clock
        self._since: float | None = None
        self._restart()

    def arguments(self) -> dict[str, Any]:
        """What to connect to next, as keyword arguments of websockets' `connect`."""
        uri = f"{self._url}/events?{urlencode(self._query)}"
        return {"uri": uri, "additional_headers": self._headers, "user_agent_header": None, "max_size": None}

    def connected(self, headers: Mapping[str, str]) -> None:
        """The server has accepted a connection: it is within reach, however quiet it is, and says where it begins."""
        self._failed = 0
        self._since = self._clock()
        position = headers.get(POSITION, "")
        if position.isdecimal():
            self._query.setdefault("after", int(position))

    def read(self, text: str | bytes) -> Message:
        """A message as it came; an anomaly is remembered as the point to resume from."""
        data = json.loads(text)
        self._restart()
        if data["kind"] == "anomaly":
            self._query["after"] = max(int(self._query.get("after", 0)), data.get("change", data["id"]))
        return Message(data["kind"], data["location"], data.get("id"), parse_time(data["time"]), data)

    def pause(self, error: Exception | None) -> float:
        """Seconds until the next attempt. Raises TidemapError when there is no sense in one.

        `error` is what the connection broke with, None if the server closed it in good order.
        """
        failure = self._failure(error)
        if self._since is not None:
            if self._clock() - self._since >= HELD_S:
                self._restart()
            self._since = None
        else:
            self._failed += 1
        if self._hopeless(failure) or self._failed >= self._retry.tries:
            raise failure
        asked_s = failure.retry_after_s or 0.0
        return max(next(self._pauses), min(asked_s, self._retry.max_s))

    def _restart(self) -> None:
        self._failed = 0
        self._pauses = self._retry.pauses()

    def _failure(self, error: Exception | None) -> TidemapError:
        if isinstance(error, InvalidStatus):
            answer = error.response
            return problem(answer.status_code, bytes(answer.body or b""), answer.headers.get("Retry-After"))
        code = error.rcvd.code if isinstance(error, ConnectionClosed) and error.rcvd else 0
        if error is not None and (code == POLICY or code in PRIVATE):
            return TidemapError(code - 4000 if code in PRIVATE else 403, "Connection refused", str(error))
        return UnreachableError(
            f"{address(self._url)}, events", error or ConnectionError("the server closed the connection")
        )

    @staticmethod
    def _hopeless(failure: TidemapError) -> bool:
        return 400 <= failure.status < 500 and failure.status not in REFUSED
