"""The blocking client: carries the requests of plans over one `httpx.Client`."""

import time
from collections.abc import Iterator
from typing import Self

import httpx
from websockets.sync.client import connect

from app.client.administration import ClientOperations, JobOperations, KeyOperations
from app.client.feed import BROKEN, Feed, Message, MessageKind
from app.client.location import LocationOperations
from app.client.operation import Blocking
from app.client.patience import Patience, persistent
from app.client.plans import Plan, Reply, Request, Run, T
from app.client.requests import path_of
from app.client.transport import Server


class Connection:
    """One pool of HTTP connections to one server, and how patiently it is used."""

    def __init__(self, server: Server, timeout_s: float, patience: Patience) -> None:
        self.server = server
        self.patience = patience
        self.http = httpx.Client(base_url=server.base, headers=server.headers, timeout=timeout_s)

    def run(self, plan: Plan[T]) -> T:
        """What the plan comes to."""
        run = Run(persistent(plan, self.patience))
        while run.request is not None:
            run.send(self._carry(run.request))
        return run.result

    def _carry(self, request: Request) -> Reply:
        time.sleep(request.after_s)
        try:
            return self.http.request(**request.arguments())
        except httpx.TransportError as error:
            return error


class LocationHandle(LocationOperations, Blocking):
    """One location."""


class Jobs(JobOperations, Blocking):
    """Long work at the server."""


class Keys(KeyOperations, Blocking):
    """Who may do what (role admin)."""


class Client(ClientOperations[LocationHandle], Blocking):
    """A Tidemap server at `url`, such as http://127.0.0.1:8000. May be shared between threads.

    `timeout_s` bounds one request, `patience` how often and how long one is tried again.
    """

    def __init__(
        self, url: str, key: str | None = None, *, timeout_s: float = 60.0, patience: Patience | None = None
    ) -> None:
        self._connection = Connection(Server(url, key), timeout_s, patience or Patience())
        super().__init__("", self._connection)
        self.jobs = Jobs("/jobs", self._connection)
        self.keys = Keys("/keys", self._connection)

    def __repr__(self) -> str:
        return f"Client({self._connection.server.base!r})"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._connection.http.close()

    def location(self, name: str) -> LocationHandle:
        """A handle of the location `name`, which need not exist yet; asks nothing of the server."""
        return LocationHandle(path_of(name), self._connection)

    def events(
        self, location: str | None = None, kind: MessageKind | None = None, after: str | int | None = None
    ) -> Iterator[Message]:
        """What happens at the server, as it happens; connects again by itself, behind the last anomaly.

        `after` replays the anomalies behind that id first (0: all), so that none is missed. Raises
        TidemapError when the server refuses, or stays out of reach longer than the client's patience.
        """
        feed = Feed(self._connection.server, self._connection.patience, location, kind, after)
        while True:
            error: Exception | None = None
            try:
                with connect(**feed.arguments()) as socket:
                    for text in socket:
                        yield feed.read(text)
            except BROKEN as broken:
                error = broken
            time.sleep(feed.pause(error))
