"""Caches bounded in bytes."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Generic, TypeVar

Value = TypeVar("Value")


class ByteCache(Generic[Value]):
    """Least recently used values are dropped once `limit` bytes are exceeded; larger ones are never kept."""

    def __init__(self, limit: int, size_of: Callable[[Value], int]) -> None:
        self._limit = limit
        self._size_of = size_of
        self._lock = Lock()
        self._values: OrderedDict[Hashable, tuple[Value, int]] = OrderedDict()
        self._bytes = 0

    def get(self, key: Hashable, load: Callable[[], Value]) -> Value:
        """The value of `key`; loaded, outside of any lock, where it is not held."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key][0]
        value = load()
        self._put(key, value)
        return value

    def drop(self, condition: Callable[[Hashable], bool]) -> None:
        """Forget the values whose key meets the condition."""
        with self._lock:
            for key in [key for key in self._values if condition(key)]:
                self._bytes -= self._values.pop(key)[1]

    def _put(self, key: Hashable, value: Value) -> None:
        size = self._size_of(value)
        if size > self._limit:
            return
        with self._lock:
            if key in self._values:
                self._bytes -= self._values.pop(key)[1]
            self._values[key] = (value, size)
            self._bytes += size
            while self._bytes > self._limit:
                self._bytes -= self._values.popitem(last=False)[1][1]
