"""Buffer pool: large buffers are written again instead of made again.

Memory that is new to the process costs more than what is written there: the system clears every page of it.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from threading import Lock
from typing import Generic, Protocol, TypeVar
from weakref import ref

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]


class Lendable(Protocol):
    """A value of which `memory` is given to others; it takes `n_bytes` in all."""

    @property
    def memory(self) -> Bytes: ...
    @property
    def n_bytes(self) -> int: ...


Value = TypeVar("Value", bound=Lendable)


@dataclass(frozen=True, slots=True, eq=False)
class BufferLease(Generic[Value]):
    """A value that nobody else gets while anybody has `memory` (n,), read-only, or anything made of that."""

    value: Value
    memory: Bytes


class BufferPool(Generic[Value]):
    """Values by key, each lent to one at a time; those of the keys that were asked for least recently are dropped once
    `limit` bytes are exceeded, and what is lent of them meanwhile stays as it is."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._lock = Lock()
        self._shelves: OrderedDict[Hashable, _Shelf[Value]] = OrderedDict()
        self._bytes = 0

    def borrow(self, key: Hashable, version: Hashable, make: Callable[[], Value]) -> BufferLease[Value]:
        """A value of `key` in this version; made, outside of any lock, where none is free.

        One version of a key is kept at a time, so that what is out of date takes no room.
        """
        with self._lock:
            free = self._free(key, version)
            if free is not None:
                return free.lend()
        item = _Item(make())
        loan = item.lend()
        with self._lock:
            self._keep(key, version, item)
        return loan

    def _free(self, key: Hashable, version: Hashable) -> "_Item[Value] | None":
        shelf = self._shelves.get(key)
        if shelf is None or shelf.version != version:
            return None
        self._shelves.move_to_end(key)
        return next((item for item in shelf.items if item.free), None)

    def _keep(self, key: Hashable, version: Hashable, item: "_Item[Value]") -> None:
        size = item.value.n_bytes
        if size > self._limit:
            return
        if key in self._shelves and self._shelves[key].version != version:
            self._clear(key)
        self._shelves.setdefault(key, _Shelf(version, [])).items.append(item)
        self._shelves.move_to_end(key)
        self._bytes += size
        while self._bytes > self._limit and len(self._shelves) > 1:
            self._clear(next(iter(self._shelves)))
        if self._bytes > self._limit:
            # So many ask for the same at once that not all of it can be kept.
            self._shelves[key].items.remove(item)
            self._bytes -= size

    def _clear(self, key: Hashable) -> None:
        self._bytes -= sum(item.value.n_bytes for item in self._shelves.pop(key).items)


class _Item(Generic[Value]):
    """A value, and a weak hold on what was lent of it last."""

    def __init__(self, value: Value) -> None:
        self.value = value
        self._lent: ref[Bytes] | None = None

    @property
    def free(self) -> bool:
        """Whether nobody has anything of what was lent."""
        return self._lent is None or self._lent() is None

    def lend(self) -> BufferLease[Value]:
        """The value with its memory as an array of which nobody has anything yet."""
        # An array over a memoryview, not a slice of an array: whatever is made of it holds on to it.
        memory = np.frombuffer(self.value.memory.data.toreadonly(), np.uint8)
        self._lent = ref(memory)
        return BufferLease(self.value, memory)


@dataclass(slots=True, eq=False)
class _Shelf(Generic[Value]):
    version: Hashable
    items: list[_Item[Value]]
