"""Caches bounded in bytes."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from threading import Lock
from typing import Generic, TypeVar

from cachetools import LRUCache

Value = TypeVar("Value")


class ByteCache(Generic[Value]):
    """Least recently used values are dropped once `limit` bytes are exceeded; larger ones are never kept."""

    def __init__(self, limit: int, size_of: Callable[[Value], int]) -> None:
        self._limit = limit
        self._size_of = size_of
        self._lock = Lock()
        self._entries: LRUCache[Hashable, _Entry[Value]] = LRUCache(limit, getsizeof=lambda entry: entry.size)

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
            return None if entry is None or entry.version != version else entry.value

    @property
    def n_bytes(self) -> int:
        """Memory of what is held, in bytes."""
        return int(self._entries.currsize)

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
                del self._entries[key]

    def _put(self, key: Hashable, entry: "_Entry[Value]") -> None:
        with self._lock:
            self._entries.pop(key, None)
            if self.takes(entry.size):
                self._entries[key] = entry


@dataclass(frozen=True, slots=True)
class _Entry(Generic[Value]):
    version: Hashable
    value: Value
    size: int
