"""The memory that bodies may take at once: being read, parsed and stored."""

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from tidemap.errors import TooManyBodiesError

MAX_WAIT_S = 5.0
"""How long a body waits for its share."""
SMALL_BYTES = 1 << 20
"""What takes no more, unpacked and parsed, never waits for what does."""
SMALL_PART = 8
"""One part in so many is for what is small."""


@dataclass(slots=True, eq=False)
class PendingGrant:
    """A share that waits to grow by `size` bytes."""

    share: "LaneShare"
    size: int
    granted: asyncio.Event = field(default_factory=asyncio.Event)


class Lane:
    """`total` bytes, given in the order of asking. For one event loop.

    One share at a time may overdraw: it never waits, so it comes to its end and gives back, however many half-read
    bodies hold the rest. So at most `total` and what one body may take is held, and nobody waits for ever.
    """

    def __init__(self, total: int, max_wait_s: float = MAX_WAIT_S) -> None:
        self.held = 0
        self._total = total
        self._max_wait_s = max_wait_s
        self._queue: deque[PendingGrant] = deque()
        self._overdrawn: LaneShare | None = None

    @contextmanager
    def share(self) -> "Iterator[LaneShare]":
        """The share of one body, given back at the end."""
        share = LaneShare(self)
        try:
            yield share
        finally:
            self.held -= share.held
            if self._overdrawn is share:
                self._overdrawn = None
            self._serve()

    async def give(self, share: "LaneShare", size: int) -> None:
        """Let a share grow. Raises TooManyBodiesError when so much does not get free in time."""
        if share is self._overdrawn or (not self._queue and self._fits(size)):
            self._give(share, size)
            return
        grant = PendingGrant(share, size)
        self._queue.append(grant)
        self._serve()
        try:
            async with asyncio.timeout(self._max_wait_s):
                await grant.granted.wait()
        except TimeoutError:
            if not grant.granted.is_set():
                raise TooManyBodiesError from None
        finally:
            if not grant.granted.is_set():
                self._queue.remove(grant)
                self._serve()

    def _serve(self) -> None:
        """Grant what waits, in its order, as far as it goes."""
        while self._queue:
            grant = self._queue[0]
            if not self._fits(grant.size):
                if self._overdrawn is not None:
                    return
                self._overdrawn = grant.share
            self._queue.popleft()
            self._give(grant.share, grant.size)
            grant.granted.set()

    def _fits(self, size: int) -> bool:
        return self.held + size <= self._total

    def _give(self, share: "LaneShare", size: int) -> None:
        self.held += size
        share.held += size


@dataclass(slots=True, eq=False)
class LaneShare:
    """What one body holds of a lane; bytes."""

    lane: Lane
    held: int = 0

    async def grow(self, size: int) -> None:
        """Hold `size` more bytes, once they are free. Raises TooManyBodiesError when that takes too long."""
        if size:
            await self.lane.give(self, size)


class Budget:
    """`total` bytes in two lanes, so that small bodies go on beside the largest: see `Lane`."""

    def __init__(self, total: int) -> None:
        self._small = Lane(total // SMALL_PART)
        self._large = Lane(total - total // SMALL_PART)

    @property
    def held(self) -> int:
        """What is given now, in both lanes."""
        return self._small.held + self._large.held

    @contextmanager
    def share(self) -> "Iterator[Share]":
        """The share of one body, given back at the end."""
        with self._small.share() as small, self._large.share() as large:
            yield Share(small, large)


@dataclass(frozen=True, slots=True, eq=False)
class Share:
    """What one body holds of a budget; bytes. It is small as long as it holds no more than SMALL_BYTES."""

    small: LaneShare
    large: LaneShare

    @property
    def held(self) -> int:
        """In both lanes."""
        return self.small.held + self.large.held

    async def grow(self, size: int) -> None:
        """Hold `size` more bytes, once they are free. Raises TooManyBodiesError when that takes too long."""
        lane = self.small if self.held + size <= SMALL_BYTES else self.large
        await lane.grow(size)
