"""The asynchronous client: carries the requests of plans over one `httpx.AsyncClient`."""

import asyncio
from collections.abc import AsyncIterator
from typing import Generic, overload

import httpx
from typing_extensions import Self, Unpack
from websockets.asyncio.client import connect

from tidemap.client.administration import ClientOperations, JobOperations, KeyOperations
from tidemap.client.feed import BROKEN, Feed, Message, MessageKind
from tidemap.client.location import LocationOperations
from tidemap.client.operation import Awaited, AwaitedPoster, R
from tidemap.client.outbox import AsyncOutbox, Outbox, PathLike, open_outbox
from tidemap.client.outbox.blocking import present
from tidemap.client.plans import Plan, Reply, Request, Run, T
from tidemap.client.posting import Postable, Queued, Receipt
from tidemap.client.requests import path_of
from tidemap.client.retry import RetryPolicy, retried
from tidemap.client.transport import RequestOptions, Server
from tidemap.schemas.observations import Accepted


class AsyncConnection:
    """One pool of HTTP connections to one server, and how patiently it is used."""

    def __init__(self, server: Server, timeout_s: float, retry: RetryPolicy) -> None:
        self.server = server
        self.retry = retry
        self.timeout_s = timeout_s
        self.outbox: Outbox | None = None
        self.http = server.open(httpx.AsyncClient, timeout_s)

    async def run(self, plan: Plan[T]) -> T:
        """What the plan comes to."""
        run = Run(retried(plan, self.retry))
        while run.request is not None:
            run.send(await self._carry(run.request))
        return run.result

    async def post(self, post: Postable) -> Receipt:
        """Send the measurements, or queue them where there is an outbox."""
        if self.outbox is None:
            return await self.run(post.plan())
        return await asyncio.to_thread(self.outbox.put, post)

    async def _carry(self, request: Request) -> Reply:
        await asyncio.sleep(request.after_s)
        try:
            return await self.http.request(**request.arguments(), timeout=self.timeout_s + request.waits_s)
        except httpx.TransportError as error:
            return error


class AsyncLocationHandle(LocationOperations, AwaitedPoster[R]):
    """One location, awaited."""


class AsyncJobs(JobOperations, Awaited):
    """Long work at the server, awaited."""


class AsyncKeys(KeyOperations, Awaited):
    """Who may do what (role admin), awaited."""


class AsyncClient(ClientOperations[AsyncLocationHandle[R]], Awaited, Generic[R]):
    """`Client` for asyncio: the same operations, awaited; lists and events are asynchronous iterators."""

    @overload
    def __init__(
        self: "AsyncClient[Accepted]",
        url: str,
        key: str | None = None,
        *,
        outbox: None = None,
        **options: Unpack[RequestOptions],
    ) -> None: ...
    @overload
    def __init__(
        self: "AsyncClient[Queued]",
        url: str,
        key: str | None = None,
        *,
        outbox: PathLike,
        **options: Unpack[RequestOptions],
    ) -> None: ...
    def __init__(
        self,
        url: str,
        key: str | None = None,
        *,
        timeout_s: float = 60.0,
        retry: RetryPolicy | None = None,
        outbox: PathLike | None = None,
        outbox_bytes: int = 1 << 30,
    ) -> None:
        server, retry = Server(url, key), retry or RetryPolicy()
        self._connection = AsyncConnection(server, timeout_s, retry)
        self._connection.outbox = open_outbox(outbox, outbox_bytes, server, timeout_s, retry)
        super().__init__("", self._connection)
        self.jobs = AsyncJobs("/jobs", self._connection)
        self.keys = AsyncKeys("/keys", self._connection)

    def __repr__(self) -> str:
        return f"AsyncClient({self._connection.server.base!r})"

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def outbox(self) -> AsyncOutbox:
        """What was observed and is not at the server yet. Raises OutboxError if this client has no outbox."""
        return AsyncOutbox(present(self._connection.outbox))

    async def close(self, flush_s: float = 0.0) -> None:
        """Close the connections. An outbox may send for `flush_s` more seconds; what is left it keeps."""
        if self._connection.outbox is not None:
            await asyncio.to_thread(self._connection.outbox.close, flush_s)
        await self._connection.http.aclose()

    def location(self, name: str) -> AsyncLocationHandle[R]:
        """A handle of the location `name`, which need not exist yet; asks nothing of the server."""
        return AsyncLocationHandle(path_of(name), self._connection)

    async def events(
        self, location: str | None = None, kind: MessageKind | None = None, after: str | int | None = None
    ) -> AsyncIterator[Message]:
        """As `Client.events`, for `async for`."""
        feed = Feed(self._connection.server, self._connection.retry, location, kind, after)
        while True:
            error: Exception | None = None
            try:
                async with connect(**feed.arguments()) as socket:
                    feed.connected(socket.response.headers if socket.response else {})
                    async for text in socket:
                        yield feed.read(text)
            except BROKEN as broken:
                error = broken
            await asyncio.sleep(feed.pause(error))
