"""How far long work is: a bar on a terminal, plain lines elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, TextIO

from tqdm import tqdm

LINE_EVERY_S = 5.0

Step = Callable[[int], None]


class Progress(Protocol):
    """Shows how far work is."""

    def task(self, what: str, total: int) -> "contextmanager[Step]":
        """For the duration of a task of `total` steps: call what it gives with the steps done since last time."""


class Silent:
    """Shows nothing."""

    @contextmanager
    def task(self, what: str, total: int) -> Iterator[Step]:
        """A task nobody looks at."""
        yield lambda _: None


class Bars:
    """A bar for each task, for people."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    @contextmanager
    def task(self, what: str, total: int) -> Iterator[Step]:
        """A bar."""
        with tqdm(total=total, desc=what, file=self._stream, unit_scale=True) as bar:
            yield bar.update


class Lines:
    """A line when a task begins and ends, and every few seconds between, for logs."""

    def __init__(self, stream: TextIO, every_s: float = LINE_EVERY_S) -> None:
        self._stream = stream
        self._every_s = every_s

    @contextmanager
    def task(self, what: str, total: int) -> Iterator[Step]:
        """Lines such as `Posting: 40 % of 5000`."""
        done, started = 0, time.monotonic()
        said = started

        def step(n: int) -> None:
            nonlocal done, said
            done += n
            if time.monotonic() - said >= self._every_s:
                said = time.monotonic()
                self._say(f"{what}: {100 * done // max(total, 1)} % of {total}")

        self._say(f"{what} ...")
        yield step
        self._say(f"{what}: done in {time.monotonic() - started:.1f} s")

    def _say(self, text: str) -> None:
        print(text, file=self._stream, flush=True)


def on(stream: TextIO) -> Bars | Lines:
    """Bars if `stream` is a terminal, lines if not."""
    return Bars(stream) if stream.isatty() else Lines(stream)
