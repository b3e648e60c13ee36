"""The gate: readers pass while it is open, and shutting it waits until none is inside."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Condition, local

from tidemap.errors import ShuttingDownError


class Gate:
    """For the readers of one process; SQLite can begin its log anew only at a moment in which nobody reads."""

    def __init__(self) -> None:
        self._changed = Condition()
        self._inside = 0
        self._shut = False
        self._closed = False
        self._mine = local()

    @contextmanager
    def inside(self) -> Iterator[None]:
        """Wait while it is shut; a thread that is inside already passes, for it would wait for itself.

        Raises ShuttingDownError once it is closed.
        """
        depth = getattr(self._mine, "depth", 0)
        with self._changed:
            while self._shut and not depth:
                self._changed.wait()
            if self._closed:
                raise ShuttingDownError
            self._inside += 1
        self._mine.depth = depth + 1
        try:
            yield
        finally:
            self._mine.depth = depth
            with self._changed:
                self._inside -= 1
                if not self._inside:
                    self._changed.notify_all()

    def close(self) -> None:
        """Let nobody in any more."""
        self._closed = True

    @contextmanager
    def shut(self, max_wait_s: float) -> Iterator[bool]:
        """Let nobody in meanwhile; whether all have left, which is waited for as long as that."""
        with self._changed:
            self._shut = True
            empty = self._changed.wait_for(lambda: not self._inside, max_wait_s)
        try:
            yield empty
        finally:
            with self._changed:
                self._shut = False
                self._changed.notify_all()
