"""The blocking client: carries the requests of plans over one `httpx.Client`."""

import time
from collections.abc import Iterator
from typing import Generic, overload

import httpx
from typing_extensions import Self, Unpack
from websockets.sync.client import connect

from tidemap.client.administration import ClientOperations, JobOperations, KeyOperations
from tidemap.client.feed import BROKEN, Feed, Message, MessageKind
from tidemap.client.location import LocationOperations
from tidemap.client.operation import Blocking, BlockingPoster, R
from tidemap.client.outbox import Outbox, PathLike, open_outbox
from tidemap.client.outbox.blocking import present
from tidemap.client.plans import Plan, Reply, Request, Run, T
from tidemap.client.posting import Postable, Queued, Receipt
from tidemap.client.requests import path_of
from tidemap.client.retry import RetryPolicy, retried
from tidemap.client.transport import RequestOptions, Server
from tidemap.schemas.observations import Accepted


class Connection:
    """One pool of HTTP connections to one server, and how patiently it is used."""

    def __init__(self, server: Server, timeout_s: float, retry: RetryPolicy) -> None:
        self.server = server
        self.retry = retry
        self.timeout_s = timeout_s
        self.outbox: Outbox | None = None
        self.http = server.open(httpx.Client, timeout_s)

    def run(self, plan: Plan[T]) -> T:
        """What the plan comes to."""
        run = Run(retried(plan, self.retry))
        while run.request is not None:
            run.send(self._carry(run.request))
        return run.result

    def post(self, post: Postable) -> Receipt:
        """Send the measurements, or queue them where there is an outbox."""
        return self.run(post.plan()) if self.outbox is None else self.outbox.put(post)

    def _carry(self, request: Request) -> Reply:
        time.sleep(request.after_s)
        try:
            return self.http.request(**request.arguments(), timeout=self.timeout_s + request.waits_s)
        except httpx.TransportError as error:
            return error


class LocationHandle(LocationOperations, BlockingPoster[R]):
    """One location."""


class Jobs(JobOperations, Blocking):
    """Long work at the server."""


class Keys(KeyOperations, Blocking):
    """Who may do what (role admin)."""


class Client(ClientOperations[LocationHandle[R]], Blocking, Generic[R]):
    """A Tidemap server at `url`, such as http://127.0.0.1:8000. May be shared between threads.

    `timeout_s` bounds one request, `retry` how often and how long it tries one again.

    With `outbox`, the path of a file on a local disk, observations are written there first, at most `outbox_bytes`
    of them, and sent in the background; see `tidemap.client.outbox`.

    Raises ValueError for an address or a key that cannot be one, OutboxError when the file is no outbox.
    """

    @overload
    def __init__(
        self: "Client[Accepted]",
        url: str,
        key: str | None = None,
        *,
        outbox: None = None,
        **options: Unpack[RequestOptions],
    ) -> None: ...
    @overload
    def __init__(
        self: "Client[Queued]", url: str, key: str | None = None, *, outbox: PathLike, **options: Unpack[RequestOptions]
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
        self._connection = Connection(server, timeout_s, retry)
        self._connection.outbox = open_outbox(outbox, outbox_bytes, server, timeout_s, retry)
        super().__init__("", self._connection)
        self.jobs = Jobs("/jobs", self._connection)
        self.keys = Keys("/keys", self._connection)

    def __repr__(self) -> str:
        return f"Client({self._connection.server.base!r})"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def outbox(self) -> Outbox:
        """What was observed and is not at the server yet. Raises OutboxError if this client has no outbox."""
        return present(self._connection.outbox)

    def close(self, flush_s: float = 0.0) -> None:
        """Close the connections. An outbox may send for `flush_s` more seconds; what is left it keeps."""
        if self._connection.outbox is not None:
            self._connection.outbox.close(flush_s)
        self._connection.http.close()

    def location(self, name: str) -> LocationHandle[R]:
        """A handle of the location `name`, which need not exist yet; asks nothing of the server."""
        return LocationHandle(path_of(name), self._connection)

    def events(
        self, location: str | None = None, kind: MessageKind | None = None, after: str | int | None = None
    ) -> Iterator[Message]:
        """What happens at the server, as it happens; connects again by itself, behind the last anomaly.

        `after` replays the anomalies behind that id first (0: all), so that none is missed. Raises
        TidemapError when the server refuses, or stays out of reach longer than the client tries.
        """
        feed = Feed(self._connection.server, self._connection.retry, location, kind, after)
        while True:
            error: Exception | None = None
            try:
                with connect(**feed.arguments()) as socket:
                    feed.connected(socket.response.headers if socket.response else {})
                    for text in socket:
                        yield feed.read(text)
            except BROKEN as broken:
                error = broken
            time.sleep(feed.pause(error))
