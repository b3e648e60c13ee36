"""Caches bounded in bytes."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from threading import Lock
from typing import Generic, TypeVar

Value = TypeVar("Value")


class ByteCache(Generic[Value]):
    """Least recently used values are dropped once `limit` bytes are exceeded; larger ones are never kept."""

    def __init__(self, limit: int, size_of: Callable[[Value], int]) -> None:
        self._limit = limit
        self._size_of = size_of
        self._lock = Lock()
        self._entries: OrderedDict[Hashable, _Entry[Value]] = OrderedDict()
        self._bytes = 0

    def get(self, key: Hashable, version: Hashable, load: Callable[[], Value]) -> Value:
        """The value of `key` in this version; loaded, outside of any lock, where it is not held.

        One version of a key is held at a time, so that what is out of date takes no room.
        """
        known = self.held(key, version)
        if known is not None:
            return known
        value = load()
        self._put(key, _Entry(version, value, self._size_of(value)))
        return value

    def held(self, key: Hashable, version: Hashable) -> Value | None:
        """The value of `key` in this version, None where it is not held."""
        with self._lock:
            entry = self._entries.get(key)
            if entry is None or entry.version != version:
                return None
            self._entries.move_to_end(key)
            return entry.value

    def latest(self, key: Hashable) -> tuple[Hashable, Value] | None:
        """The version of `key` that is held, and its value."""
        with self._lock:
            entry = self._entries.get(key)
            return None if entry is None else (entry.version, entry.value)

    def takes(self, size: int) -> bool:
        """Whether a value of so many bytes could be held."""
        return size <= self._limit

    def drop(self, condition: Callable[[Hashable], bool]) -> None:
        """Forget the values whose key meets the condition."""
        with self._lock:
            for key in [key for key in self._entries if condition(key)]:
                self._remove(key)

    def _put(self, key: Hashable, entry: "_Entry[Value]") -> None:
        with self._lock:
            self._remove(key)
            if not self.takes(entry.size):
                return
            self._entries[key] = entry
            self._bytes += entry.size
            while self._bytes > self._limit:
                self._remove(next(iter(self._entries)))

    def _remove(self, key: Hashable) -> None:
        entry = self._entries.pop(key, None)
        self._bytes -= entry.size if entry is not None else 0


@dataclass(frozen=True, slots=True)
class _Entry(Generic[Value]):
    version: Hashable
    value: Value
    size: int
