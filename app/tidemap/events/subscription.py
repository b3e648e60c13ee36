"""Subscriptions: which messages somebody wants, those that were missed, and those of the bus as they come.

Three levels, each over the one before: `listen` calls a function, a `Subscription` lets messages wait for a reader in
any thread, and an `EventStream` is a reader in an event loop that gets what it has missed first.
"""

import asyncio
import time
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from threading import Lock
from types import TracebackType
from typing import get_args

from tidemap.events.bus import Bus, Listener
from tidemap.events.messages import EventMessage, Kind
from tidemap.scope import EVERYWHERE, Scope

KINDS: frozenset[str] = frozenset(get_args(Kind))
REPLAY_PAGE = 500
"""Missed messages that are asked for at once."""
Replay = Callable[[int, int], Awaitable[Sequence[EventMessage]]]
"""The anomalies that changed after a number, in order of that, at most so many: (after, limit)."""


@dataclass(frozen=True, slots=True)
class EventFilter:
    """Which messages somebody wants: of one location or all that they may see, of some kinds.

    `after` is the last change of an anomaly that is known already; with it, those since are wanted too.
    """

    location: str | None = None
    kinds: frozenset[str] = KINDS
    after: int | None = None
    scope: Scope = EVERYWHERE

    def wants(self, message: EventMessage) -> bool:
        """Whether this message is among them."""
        return message.kind in self.kinds and (
            self._wants_pattern(message.location) if message.location.endswith("*") else self._wants(message.location)
        )

    def _wants(self, location: str) -> bool:
        return self.location in (None, location) and self.scope.holds(location)

    def _wants_pattern(self, pattern: str) -> bool:
        """Whether what concerns all that the pattern holds concerns something that is wanted."""
        concerned = Scope((pattern,))
        return self.scope.touches(concerned) and (self.location is None or concerned.holds(self.location))

    @property
    def resumes(self) -> bool:
        """Whether stored anomalies are wanted too."""
        return self.after is not None and "anomaly" in self.kinds


def listen(bus: Bus, wanted: EventFilter, listener: Listener) -> Callable[[], None]:
    """Call `listener`, in the publisher's thread, with what is wanted from now on; returns what ends that."""
    return bus.subscribe(lambda message: listener(message) if wanted.wants(message) else None)


class Subscription(AbstractContextManager["Subscription"]):
    """Messages that wait for one reader, in any thread.

    `wake` is called in the publisher's thread, when there is something to take again and when it overflows. With more
    than `limit` waiting (None: any number) all are dropped and no more are taken in: the reader has to begin again.
    """

    def __init__(self, bus: Bus, wanted: EventFilter, wake: Callable[[], None], limit: int | None = None) -> None:
        self._wake = wake
        self._limit = limit
        self._lock = Lock()
        self._waiting: deque[tuple[float, EventMessage]] = deque()
        self._overflowed = False
        self.waited_s = 0.0
        """How long the message that was taken last had waited."""
        self._unsubscribe = listen(bus, wanted, self._put)

    @property
    def overflowed(self) -> bool:
        """Whether more came than the reader took."""
        return self._overflowed

    def take(self) -> EventMessage | None:
        """The next message; None when none waits."""
        with self._lock:
            if not self._waiting:
                return None
            since, message = self._waiting.popleft()
        self.waited_s = time.monotonic() - since
        return message

    def close(self) -> None:
        """Take in no more."""
        self._unsubscribe()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _put(self, message: EventMessage) -> None:
        with self._lock:
            if self._overflowed:
                return
            first = not self._waiting
            self._overflowed = self._limit is not None and len(self._waiting) >= self._limit
            if self._overflowed:
                self._waiting.clear()
            else:
                self._waiting.append((time.monotonic(), message))
        if first or self._overflowed:
            self._wake()


class EventStream(AbstractContextManager["EventStream"]):
    """What one reader hears: the anomalies that it has missed, then messages as they happen, none twice.

    An endless iterator for the event loop it is made in. `overflowed` is set when more than
    `limit` messages wait for the reader: nothing more comes then, and it is to be dropped. `lag` is called with the
    seconds that each message waited.
    """

    def __init__(
        self, bus: Bus, wanted: EventFilter, limit: int, replay: Replay, lag: Callable[[float], object] = lambda _: None
    ) -> None:
        self._lag = lag
        self._loop = asyncio.get_running_loop()
        self._replay = replay
        self._missed: deque[EventMessage] = deque()
        self._more = wanted.resumes
        self._last = wanted.after or 0 if wanted.resumes else 0
        self._filled = asyncio.Event()
        self.overflowed = asyncio.Event()
        self._subscription = Subscription(bus, wanted, self._wake, limit)

    def __aiter__(self) -> "EventStream":
        return self

    async def __anext__(self) -> EventMessage:
        return await self._next_missed() or await self._next_new()

    def at_hand(self) -> list[EventMessage]:
        """What follows the message that was taken last, as far as nobody has to wait for it."""
        if self._more or self._missed:
            return []
        return list(iter(self._new_at_hand, None))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._subscription.close()

    async def _next_missed(self) -> EventMessage | None:
        """The next of what was stored before; None when the reader has all."""
        if self._more and not self._missed:
            page = await self._replay(self._last, REPLAY_PAGE)
            self._more = len(page) == REPLAY_PAGE
            self._missed.extend(page)
        if not self._missed:
            return None
        message = self._missed.popleft()
        self._last = message.position
        return message

    async def _next_new(self) -> EventMessage:
        """The next that happens and was not among those missed."""
        while (message := self._new_at_hand()) is None:
            self._filled.clear()
            await self._filled.wait()
        return message

    def _new_at_hand(self) -> EventMessage | None:
        while (message := self._subscription.take()) is not None:
            if message.kind != "anomaly" or message.position > self._last:
                self._lag(self._subscription.waited_s)
                return message
        return None

    def _wake(self) -> None:
        self._loop.call_soon_threadsafe(self._woken)

    def _woken(self) -> None:
        self._filled.set()
        if self._subscription.overflowed:
            self.overflowed.set()
