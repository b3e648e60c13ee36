"""A reader of Server-Sent Events, as a browser's EventSource reads them."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import httpx

from tests.support.waiting import WAIT_S
from tidemap.api.server_sent import HEARTBEAT_S

MAX_COMMENTS = WAIT_S / HEARTBEAT_S


@dataclass
class EventSource:
    """The open stream at an address, which remembers the last id as browsers do."""

    lines: Iterator[str]
    headers: httpx.Headers
    last_id: str | None = None
    comments: list[str] = field(default_factory=list)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Messages, until the stream ends."""
        data = ""
        for line in self.lines:
            name, _, value = line.partition(":")
            if name == "id":
                self.last_id = value.strip()
            elif name == "data":
                data += value.strip()
            elif line.startswith(":"):
                self.comments.append(value)
                assert len(self.comments) < MAX_COMMENTS, "nothing comes any more"
            elif not line and data:
                yield json.loads(data)
                data = ""

    def take(self, number: int) -> list[dict[str, Any]]:
        """The next messages."""
        return list(islice(self, number))


@contextmanager
def event_source(
    url: str, query: str = "", last_id: str | None = None, headers: dict[str, str] | None = None
) -> Iterator[EventSource]:
    """Connected to the stream of a server."""
    sent = {"Accept": "text/event-stream", **(headers or {})} | ({"Last-Event-ID": last_id} if last_id else {})
    with (
        httpx.Client(trust_env=False, timeout=WAIT_S) as http,
        http.stream("GET", f"{url}/api/v1/events{query}", headers=sent) as answer,
    ):
        if answer.status_code != 200:
            answer.read()
            answer.raise_for_status()
        yield EventSource(answer.iter_lines(), answer.headers, last_id)
