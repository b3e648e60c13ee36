"""The stream of messages over real WebSockets that break."""

import asyncio
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from urllib.parse import parse_qs, urlsplit

import pytest
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from tidemap.client import AsyncClient, Client, Message, RetryPolicy, TidemapError, UnreachableError

QUICK = RetryPolicy(tries=3, first_s=0.001, max_s=0.01)


def message(kind: str, number: int) -> str:
    said = {"kind": kind, "location": "lab", "id": number, "time": "1970-01-01T00:01:00Z", "cells": 3}
    return json.dumps(said)


class Stream:
    """A WebSocket server that sends each connection its own messages and closes it with its own code."""

    def __init__(self, *connections: tuple[int, list[str]]) -> None:
        self.connections = list(connections)
        self.queries: list[dict[str, list[str]]] = []
        self.keys: list[str | None] = []
        self.refuse: int | None = None
        self.position: str | None = None
        self.url = ""

    def admit(self, connection: ServerConnection, request: Request) -> Response | None:
        self.queries.append(parse_qs(urlsplit(request.path).query))
        self.keys.append(request.headers.get("Authorization"))
        problem = {
            "type": "x#forbidden",
            "title": "Not allowed",
            "status": 403,
            "detail": "This key may not.",
        }
        return None if self.refuse is None else connection.respond(self.refuse, json.dumps(problem))

    def name_position(self, connection: ServerConnection, request: Request, response: Response) -> None:
        if self.position is not None:
            response.headers["Last-Event-ID"] = self.position

    def send(self, connection: ServerConnection) -> None:
        code, messages = self.connections.pop(0) if self.connections else (1001, [])
        for text in messages:
            connection.send(text)
        connection.close(code)


@contextmanager
def streaming(*connections: tuple[int, list[str]]) -> Iterator[Stream]:
    stream = Stream(*connections)
    with serve(
        stream.send, "127.0.0.1", 0, process_request=stream.admit, process_response=stream.name_position
    ) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        stream.url = f"http://127.0.0.1:{server.socket.getsockname()[1]}"
        try:
            yield stream
        finally:
            server.shutdown()
            thread.join()


def blocking(url: str, n: int) -> list[Message]:
    with Client(url, key="tm_k", retry=QUICK) as client:
        return list(islice(client.events(location="lab"), n))


def awaited(url: str, n: int) -> list[Message]:
    async def read() -> list[Message]:
        found: list[Message] = []
        async with AsyncClient(url, key="tm_k", retry=QUICK) as client:
            async for each in client.events(location="lab"):
                found.append(each)
                if len(found) == n:
                    break
        return found

    return asyncio.run(read())


both = pytest.mark.parametrize("read", [blocking, awaited])
Read = Callable[[str, int], list[Message]]


@both
@pytest.mark.parametrize("code", [1001, 1011, 1013])
def test_a_broken_stream_goes_on_behind_the_last_anomaly(read: Read, code: int) -> None:
    first = [message("anomaly", 7), message("update", 40)]
    with streaming((code, first), (code, []), (code, [message("anomaly", 8)])) as stream:
        messages = read(stream.url, 3)
    assert [(each.kind, each.id) for each in messages] == [("anomaly", 7), ("update", 40), ("anomaly", 8)]
    assert stream.queries[0] == {"location": ["lab"]}
    assert all(query == {"location": ["lab"], "after": ["7"]} for query in stream.queries[1:])
    assert set(stream.keys) == {"Bearer tm_k"}
    assert (messages[0].time, messages[0].location, messages[0].data["cells"]) == (60, "lab", 3)


@both
def test_an_older_anomaly_told_again_does_not_move_the_point_to_resume_from(read: Read) -> None:
    first = [message("anomaly", 7), message("anomaly", 3)]
    with streaming((1001, first), (1001, [message("anomaly", 8)])) as stream:
        read(stream.url, 3)
    assert stream.queries[1]["after"] == ["7"]


@both
def test_a_refusal_is_raised_in_the_servers_words(read: Read) -> None:
    with streaming() as stream:
        stream.refuse = 403
        with pytest.raises(TidemapError) as caught:
            read(stream.url, 1)
    assert caught.value.status == 403
    assert len(stream.queries) == 1


@both
@pytest.mark.parametrize(("code", "status"), [(1008, 403), (4404, 404)])
def test_a_close_that_means_no_is_not_asked_again(read: Read, code: int, status: int) -> None:
    with streaming((code, [])) as stream, pytest.raises(TidemapError) as caught:
        read(stream.url, 1)
    assert caught.value.status == status
    assert len(stream.queries) == 1


@both
def test_retry_ends_when_nothing_comes_back(read: Read) -> None:
    with streaming() as stream:
        stream.refuse = 503
        with pytest.raises(TidemapError) as caught:
            read(stream.url, 1)
        assert caught.value.status == 503
        assert len(stream.queries) == QUICK.tries
    with pytest.raises(UnreachableError):
        read(stream.url, 1)


@both
def test_connections_that_end_without_a_message_are_no_failures(read: Read) -> None:
    quiet: list[tuple[int, list[str]]] = [(1001, [])] * (3 * QUICK.tries)
    with streaming(*quiet, (1001, [message("anomaly", 8)])) as stream:
        assert [each.id for each in read(stream.url, 1)] == [8]
    assert len(stream.queries) == len(quiet) + 1


@both
def test_the_position_of_the_first_connection_is_where_it_resumes(read: Read) -> None:
    with streaming((1001, []), (1001, [message("anomaly", 8)])) as stream:
        stream.position = "5"
        assert [each.id for each in read(stream.url, 1)] == [8]
    assert [query.get("after") for query in stream.queries] == [None, ["5"]]


def test_a_client_that_tries_once_stays_with_a_quiet_location() -> None:
    quiet: list[tuple[int, list[str]]] = [(1001, [])] * 4
    with streaming(*quiet, (1001, [message("anomaly", 8)])) as stream:
        with Client(stream.url, retry=RetryPolicy(tries=1, first_s=0.001, max_s=0.01)) as client:
            assert next(client.events()).id == 8
        assert len(stream.queries) == 5
