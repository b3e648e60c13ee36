"""Buffer pool: large buffers are written again instead of made again.

Memory that is new to the process costs more than what is written there: the system clears every page of it.
"""

from collections.abc import Callable, Hashable
from contextlib import suppress
from dataclasses import dataclass
from threading import Lock
from typing import Generic, Protocol, TypeVar
from weakref import ref

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]


class Pooled(Protocol):
    """A value whose `memory` others lease; it takes `n_bytes` in all."""

    @property
    def memory(self) -> Bytes: ...
    @property
    def n_bytes(self) -> int: ...


Value = TypeVar("Value", bound=Pooled)


@dataclass(frozen=True, slots=True, eq=False)
class BufferLease(Generic[Value]):
    """A value that nobody else gets while anybody has `memory` (n,), read-only, or anything made of that."""

    value: Value
    memory: Bytes


class BufferPool(Generic[Value]):
    """Values by key, each leased to one at a time; those of the keys that were asked for least recently are dropped
    once `limit` bytes are exceeded, and what is leased of them meanwhile stays as it is."""

    def __init__(self, limit: int) -> None:
        self._lock = Lock()
        self._shelves: LRUCache[Hashable, _Shelf[Value]] = LRUCache(limit, getsizeof=lambda shelf: shelf.n_bytes)

    @property
    def n_bytes(self) -> int:
        """Memory of what is kept, in bytes."""
        return int(self._shelves.currsize)

    def lease(self, key: Hashable, version: Hashable, make: Callable[[], Value]) -> BufferLease[Value]:
        """A value of `key` in this version; made, outside of any lock, where none is free.

        One version of a key is kept at a time, so that what is out of date takes no room.
        """
        with self._lock:
            free = self._free(key, version)
            if free is not None:
                return free.lease()
        item = _Item(make())
        lease = item.lease()
        with self._lock:
            self._keep(key, version, item)
        return lease

    def _free(self, key: Hashable, version: Hashable) -> "_Item[Value] | None":
        shelf = self._shelves.get(key)
        if shelf is None or shelf.version != version:
            return None
        return next((item for item in shelf.items if item.free), None)

    def _keep(self, key: Hashable, version: Hashable, item: "_Item[Value]") -> None:
        shelf = self._shelves.get(key)
        if shelf is not None and shelf.version != version:
            del self._shelves[key]
            shelf = None
        # The cache refuses what is larger than all of it: so many ask for the same at once, or for so much.
        with suppress(ValueError):
            self._shelves[key] = _Shelf(version, (*shelf.items, item) if shelf else (item,))


class _Item(Generic[Value]):
    """A value, and a weak hold on what was leased of it last."""

    def __init__(self, value: Value) -> None:
        self.value = value
        self._leased: ref[Bytes] | None = None

    @property
    def free(self) -> bool:
        """Whether nobody has anything of what was leased."""
        return self._leased is None or self._leased() is None

    def lease(self) -> BufferLease[Value]:
        """The value with its memory as an array that nobody has yet."""
        # An array over a memoryview, not a slice of an array: whatever is made of it holds on to it.
        memory = np.frombuffer(self.value.memory.data.toreadonly(), np.uint8)
        self._leased = ref(memory)
        return BufferLease(self.value, memory)


@dataclass(frozen=True, slots=True, eq=False)
class _Shelf(Generic[Value]):
    version: Hashable
    items: tuple[_Item[Value], ...]

    @property
    def n_bytes(self) -> int:
        return sum(item.value.n_bytes for item in self.items)
