"""The outbox of a client."""

import math
import os
import threading
import time
from pathlib import Path
from typing import TypeAlias

from tidemap.client.errors import OutboxError
from tidemap.client.outbox.file import prepare
from tidemap.client.outbox.sender import Sender
from tidemap.client.outbox.store import OutboxStore, Pending, Refused
from tidemap.client.posting import Postable, Queued
from tidemap.client.requests import path_of
from tidemap.client.retry import RetryPolicy
from tidemap.client.transport import Server

PathLike: TypeAlias = str | os.PathLike[str]
GLANCE_S = 0.02
"""How often `flush` looks whether it is done; the sender may be another process."""


class Outbox:
    """What was observed and is not at the server yet, in the file `path`. May be shared between threads.

    It holds at most `most_bytes` of batches, refused ones included; the file is a little larger. All methods
    raise OutboxError when the file fails.
    """

    def __init__(self, path: Path, most_bytes: int, sender: Sender) -> None:
        self.path = path
        self.most_bytes = most_bytes
        self._sender = sender
        self._closed = threading.Event()
        self._store = OutboxStore(path, durable=True)
        # Reads wait for no write of another thread to reach the disk.
        self._reader = OutboxStore(path, durable=True)
        sender.start()

    def __repr__(self) -> str:
        return f"Outbox({str(self.path)!r})"

    def put(self, post: Postable) -> Queued:
        """Keep all measurements of a post, durably. Raises OutboxFullError, or OutboxError, and keeps none then."""
        queued = self._store.put(post.batches(), self.most_bytes)
        self._sender.wake()
        return queued

    @property
    def pending(self) -> Pending:
        """How much is still to be sent."""
        return self._reader.pending()

    def flush(self, timeout_s: float | None = None) -> bool:
        """Wait until everything was sent, or refused; False if `timeout_s` was too short. Cuts pauses short."""
        deadline = self.hurry(timeout_s)
        while self.pending.batches:
            if time.monotonic() >= deadline or self._closed.is_set():
                return False
            time.sleep(GLANCE_S)
        return True

    def hurry(self, timeout_s: float | None) -> float:
        """Have the sender try at once; the time (monotonic) in `timeout_s` seconds."""
        self._sender.hurry()
        return time.monotonic() + (math.inf if timeout_s is None else timeout_s)

    def refused(self) -> list[Refused]:
        """What the server has refused for good, oldest first."""
        return self._reader.refused()

    def retry(self, number: int) -> None:
        """Send a refused batch again, before all later ones of its location. Raises OutboxError if there is none."""
        self._store.retry(number)
        self._sender.wake()

    def move(self, number: int, location: str) -> None:
        """Send a refused batch to the location of this name. Raises OutboxError if there is none."""
        self._store.move(number, path_of(location))
        self._sender.wake()

    def discard(self, number: int) -> None:
        """Throw a refused batch away. Raises OutboxError if there is none."""
        self._store.discard(number)

    def close(self, flush_s: float = 0.0) -> None:
        """Stop sending, after `flush_s` seconds at most to send all; what is left the next client sends."""
        if self._closed.is_set():
            return
        try:
            if flush_s > 0:
                self.flush(flush_s)
        finally:
            self._closed.set()
            self._sender.stop()
            self._store.close()
            self._reader.close()


def open_outbox(
    path: PathLike | None, most_bytes: int, server: Server, timeout_s: float, retry: RetryPolicy
) -> Outbox | None:
    """The outbox at `path`, sending; none without a path. Raises OutboxError when the file is no outbox."""
    if path is None:
        return None
    absolute = Path(path).absolute()
    prepare(absolute)
    return Outbox(absolute, most_bytes, Sender(absolute, server, timeout_s, retry))


def present(outbox: Outbox | None) -> Outbox:
    """The outbox. Raises OutboxError if the client has none."""
    if outbox is None:
        raise OutboxError("this client has no outbox; give it one with outbox=PATH")
    return outbox
