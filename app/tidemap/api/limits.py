"""How many requests a key may send, and how many wrong keys an address."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Lock

from cachetools import LRUCache, TTLCache

from tidemap.errors import RateLimitError
from tidemap.services.keys import Claim
from tidemap.settings import Settings

MAX_NAMES = 10_000
USED_S = 60.0
"""How exactly it is known when a key was used last."""
BELIEVED_S = 60.0
"""How long bodies of a sender are read without asking first who it is; nothing is stored before that is confirmed."""


class Rate:
    """Of each name at most `burst` at once, and `per_s` a second for long; 0: any number. May be shared by threads.

    A name is remembered by the time at which it may send a whole burst again (the generic cell rate algorithm), of
    the `most` that came last.
    """

    def __init__(
        self, per_s: float, burst: float, clock: Callable[[], float] = time.monotonic, most: int = MAX_NAMES
    ) -> None:
        self._per_s = per_s
        self._burst = burst
        self._clock = clock
        self._whole: LRUCache[str, float] = LRUCache(most)
        self._lock = Lock()

    def check(self, name: str) -> None:
        """Raises RateLimitError when the name has nothing left."""
        if self._per_s > 0 and (wait_s := self._wait_s(name)) > 0:
            raise RateLimitError(math.ceil(wait_s))

    def spend(self, name: str) -> None:
        """Take one from what the name has left."""
        with self._lock:
            now = self._clock()
            self._whole[name] = max(self._whole.get(name, now), now) + (1 / self._per_s if self._per_s > 0 else 0)

    def take(self, name: str) -> None:
        """Take one. Raises RateLimitError when the name has nothing left."""
        self.check(name)
        self.spend(name)

    def _wait_s(self, name: str) -> float:
        """Seconds until one is left."""
        with self._lock:
            whole = self._whole.get(name, -math.inf)
        return whole - self._clock() - (self._burst - 1) / self._per_s


class Lately:
    """The `most` secrets that were right last, kept as hashes only. May be shared by threads."""

    def __init__(self, most: int = MAX_NAMES) -> None:
        self._right: LRUCache[int, None] = LRUCache(most)
        self._lock = Lock()

    def add(self, secret: str) -> None:
        """This one was right."""
        with self._lock:
            self._right[hash(secret)] = None

    def __contains__(self, secret: str) -> bool:
        return hash(secret) in self._right


class Uses:
    """Which keys were used within the last USED_S: that is noted once in so long. May be shared by threads."""

    def __init__(self, clock: Callable[[], float] = time.monotonic, most: int = MAX_NAMES) -> None:
        self._noted: TTLCache[int, None] = TTLCache(most, USED_S, timer=clock)
        self._lock = Lock()

    def due(self, key_id: int) -> bool:
        """Whether to note this use; if so, it is taken as noted."""
        with self._lock:
            known = key_id in self._noted
            if not known:
                self._noted[key_id] = None
        return not known


class Senders:
    """Who posted lately, by the hash of their secret: at most `most`, each for BELIEVED_S. For one event loop."""

    def __init__(self, clock: Callable[[], float] = time.monotonic, most: int = MAX_NAMES) -> None:
        self._known: TTLCache[bytes | None, Claim] = TTLCache(most, BELIEVED_S, timer=clock)

    def add(self, claim: Claim) -> None:
        """This is who it was, just now."""
        self._known[claim.digest] = claim

    def get(self, digest: bytes | None) -> Claim | None:
        """Who it was; that may not be so any more."""
        return self._known.get(digest)

    def forget(self, claim: Claim) -> None:
        """It is not so any more."""
        self._known.pop(claim.digest, None)


@dataclass(frozen=True, slots=True)
class Limits:
    """The rates of a server: requests by key, or by address where none is needed; wrong keys by address.

    A key that was right lately is looked up however many wrong ones come from its address: a client that guesses, or
    that goes on sending a revoked key, locks out nobody beside it.
    """

    requests: Rate
    wrong_keys: Rate
    right_keys: Lately
    uses: Uses = field(default_factory=Uses)

    @classmethod
    def of(cls, settings: Settings) -> "Limits":
        """As the settings have them."""
        wrong = settings.wrong_keys_per_minute
        requests = Rate(settings.requests_per_s, settings.requests_burst)
        return cls(requests, Rate(wrong / 60, max(wrong, 1)), Lately())
