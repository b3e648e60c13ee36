"""The asynchronous client: carries the requests of plans over one `httpx.AsyncClient`."""

import asyncio
from collections.abc import AsyncIterator
from typing import Self

import httpx
from websockets.asyncio.client import connect

from app.client.administration import ClientOperations, JobOperations, KeyOperations
from app.client.feed import BROKEN, Feed, Message, MessageKind
from app.client.location import LocationOperations
from app.client.operation import Awaited
from app.client.patience import Patience, persistent
from app.client.plans import Plan, Reply, Request, Run, T
from app.client.requests import path_of
from app.client.transport import Server


class AsyncConnection:
    """One pool of HTTP connections to one server, and how patiently it is used."""

    def __init__(self, server: Server, timeout_s: float, patience: Patience) -> None:
        self.server = server
        self.patience = patience
        self.http = httpx.AsyncClient(base_url=server.base, headers=server.headers, timeout=timeout_s)

    async def run(self, plan: Plan[T]) -> T:
        """What the plan comes to."""
        run = Run(persistent(plan, self.patience))
        while run.request is not None:
            run.send(await self._carry(run.request))
        return run.result

    async def _carry(self, request: Request) -> Reply:
        await asyncio.sleep(request.after_s)
        try:
            return await self.http.request(**request.arguments())
        except httpx.TransportError as error:
            return error


class AsyncLocationHandle(LocationOperations, Awaited):
    """One location, awaited."""


class AsyncJobs(JobOperations, Awaited):
    """Long work at the server, awaited."""


class AsyncKeys(KeyOperations, Awaited):
    """Who may do what (role admin), awaited."""


class AsyncClient(ClientOperations[AsyncLocationHandle], Awaited):
    """`Client` for asyncio: the same operations, awaited; lists and events are asynchronous iterators."""

    def __init__(
        self, url: str, key: str | None = None, *, timeout_s: float = 60.0, patience: Patience | None = None
    ) -> None:
        self._connection = AsyncConnection(Server(url, key), timeout_s, patience or Patience())
        super().__init__("", self._connection)
        self.jobs = AsyncJobs("/jobs", self._connection)
        self.keys = AsyncKeys("/keys", self._connection)

    def __repr__(self) -> str:
        return f"AsyncClient({self._connection.server.base!r})"

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connections."""
        await self._connection.http.aclose()

    def location(self, name: str) -> AsyncLocationHandle:
        """A handle of the location `name`, which need not exist yet; asks nothing of the server."""
        return AsyncLocationHandle(path_of(name), self._connection)

    async def events(
        self, location: str | None = None, kind: MessageKind | None = None, after: str | int | None = None
    ) -> AsyncIterator[Message]:
        """As `Client.events`, for `async for`."""
        feed = Feed(self._connection.server, self._connection.patience, location, kind, after)
        while True:
            error: Exception | None = None
            try:
                async with connect(**feed.arguments()) as socket:
                    async for text in socket:
                        yield feed.read(text)
            except BROKEN as broken:
                error = broken
            await asyncio.sleep(feed.pause(error))
