"""The relay: each process on a PostgreSQL database hears what any of them has done."""

import logging
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from time import monotonic, sleep
from typing import Any
from uuid import uuid4

from sqlalchemy import make_url

from tidemap.errors import BusyError
from tidemap.events.messages import EventMessage
from tidemap.events.subscription import EventFilter
from tidemap.services.context import Context
from tidemap.services.messages import latest_change, missed_changes
from tidemap.storage.channel import Channel
from tidemap.workers.hints import Hint
from tidemap.workers.worker import Worker

log = logging.getLogger(__name__)
CATCH_UP_S = 2.0
"""How often to look for changes of events that came without a hint: their process may have died before it could."""
LISTEN_S = 0.5
PAGE = 500
STOP_S = 3.0
"""How long the end waits for what is not delivered yet, and then for each thread."""
DRAIN_S = 0.02
MAX_UNSENT = 10_000
"""Hints that wait while none can be sent; the oldest are dropped then."""


class Relay:
    """One thread delivers what this process published and what others say they did; another one listens to them.

    The rows are the truth: changes of events are read in the order of their numbers, which is that of the commits, so
    every process delivers the first and the latest of each event once and in that order, whatever becomes of its
    connections. The rest are hints.
    """

    def __init__(self, ctx: Context) -> None:
        self._ctx = ctx
        self._origin = uuid4().hex
        self._waiting: deque[EventMessage | Hint] = deque()
        self._unsent: deque[str] = deque(maxlen=MAX_UNSENT)
        self._incoming, self._outgoing = Channel(ctx.settings.url), Channel(ctx.settings.url)
        self._delivery = Worker("relay", CATCH_UP_S, self._deliver_waiting)
        self._listener = Worker("relay-listener", LISTEN_S, self._listen)
        self._cursor = 0
        self._joined: dict[int, list[int]] = {}
        self._looked = monotonic()
        self._restore: Callable[[], None] = lambda: None

    def start(self) -> None:
        """Begin: what the bus is given from now on goes through here."""
        self._cursor = latest_change(self._ctx)
        self._restore = self._ctx.bus.redirect(self._put)
        self._delivery.start()
        self._listener.start()

    def stop(self) -> None:
        """End, once what waits is delivered; a database that does not answer is waited for a few seconds only.

        What the bus is given later is delivered here alone.
        """
        self._drain()
        self._restore()
        for worker, channel in ((self._listener, self._incoming), (self._delivery, self._outgoing)):
            worker.request_stop()
            if worker.join(STOP_S):
                channel.close()
            else:
                # Its thread ends with the process, and its connection with the thread.
                log.warning("the relay ends without an answer from the database")

    def _drain(self) -> None:
        until = monotonic() + STOP_S
        while self._waiting and monotonic() < until:
            self._delivery.wake()
            sleep(DRAIN_S)

    def alive(self) -> bool:
        """Whether it is at work."""
        return self._delivery.alive() and self._listener.alive()

    def _put(self, item: EventMessage | Hint) -> None:
        self._waiting.append(item)
        self._delivery.wake()

    def _listen(self) -> None:
        before = self._incoming.listens
        heard = self._incoming.listen(LISTEN_S)
        if not before:
            # What was sent before it listened is lost; the rows are not.
            self._looked = 0.0
            self._delivery.wake()
        for text in heard:
            hint = Hint.read(text)
            if hint is None:
                log.debug("a notification is no hint that is known here: %.200s", text)
            elif hint.origin != self._origin:
                self._put(hint)
        self._listener.wake()

    def _deliver_waiting(self) -> None:
        if monotonic() - self._looked >= CATCH_UP_S:
            self._catch_up()
        try:
            while self._waiting:
                self._try(self._waiting[0])
                # Only now: where the database is away, it is delivered later.
                self._waiting.popleft()
        finally:
            self._send()

    def _send(self) -> None:
        """Send the hints of what was delivered; they wait where that is impossible."""
        texts = list(self._unsent)
        if texts:
            with suppress(BusyError):
                self._outgoing.send(texts)
                self._unsent.clear()

    def _try(self, item: EventMessage | Hint) -> None:
        """Deliver it here, and have others hear of it. Raises BusyError where the database is away."""
        try:
            if item.kind == "anomaly":
                self._note(item.id, item.data)
                self._catch_up()
            elif isinstance(item, Hint):
                self._ctx.caches.locations.forget()
                self._ctx.bus.deliver(item.message())
            else:
                self._ctx.bus.deliver(item)
            if isinstance(item, EventMessage):
                self._unsent.append(Hint.of(self._origin, item).text())
        except BusyError:
            raise
        except Exception:
            log.exception("a message was not delivered: %s", item)

    def _note(self, event_id: int, data: Mapping[str, Any]) -> None:
        """Take note of what the rows do not say of a change that is not delivered yet."""
        if (data.get("change") or 0) <= self._cursor:
            return
        # Once each: where the database is away, this is called again.
        joined = dict.fromkeys([*self._joined.get(event_id, ()), *(data.get("joined") or ())])
        if joined:
            self._joined[event_id] = list(joined)

    def _catch_up(self) -> None:
        """Deliver the changes of events that are stored and were not delivered yet."""
        page = PAGE
        while page == PAGE:
            missed = missed_changes(self._ctx, EventFilter(), self._cursor, PAGE)
            for message in missed:
                if message.data["update"]:
                    message.data["joined"] = self._joined.pop(message.id, [])
                self._ctx.bus.deliver(message)
                self._cursor = message.position
            page = len(missed)
        self._joined.clear()
        self._looked = monotonic()


@contextmanager
def relayed(ctx: Context) -> Iterator[dict[str, Callable[[], bool]]]:
    """A relay where other processes may work on the same database; whether it is alive, by its name."""
    if make_url(ctx.settings.url).get_backend_name() != "postgresql":
        yield {}
        return
    relay = Relay(ctx)
    relay.start()
    try:
        yield {"relay": relay.alive}
    finally:
        relay.stop()
