"""How far long work is: a bar on a terminal, plain lines elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Protocol, TextIO, TypeAlias

from tqdm import tqdm

LINE_EVERY_S = 5.0

Step: TypeAlias = Callable[[int], object]


class Progress(Protocol):
    """Shows how far work is."""

    def task(self, what: str, total: int) -> AbstractContextManager[Step]:
        """While a task of `total` steps, 0 if nobody knows, lasts: call what it gives with the steps since the last."""


class Silent:
    """Shows nothing."""

    def task(self, what: str, total: int) -> AbstractContextManager[Step]:
        """A task nobody looks at."""
        return nullcontext(lambda _: None)


class ShownProgress:
    """Bars if `stream` is a terminal, lines such as `Posting: 40 % of 5000` if not."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def task(self, what: str, total: int) -> AbstractContextManager[Step]:
        """A bar, or lines at the beginning, at the end and every few seconds between."""
        return self._shown(what, total)

    @contextmanager
    def share(self, what: str) -> Iterator[Callable[[int, int], None]]:
        """While a task lasts whose length becomes known on the way: call what it gives with (done, total) steps."""
        shown = self._shown(what, 0)
        with shown:
            yield shown.reach

    def _shown(self, what: str, total: int) -> "Bar | Lines":
        kind = Bar if self._stream.isatty() else Lines
        return kind(what, total, self._stream)


class Bar:
    """A bar for people."""

    def __init__(self, what: str, total: int, stream: TextIO) -> None:
        self._bar = tqdm(total=total or None, desc=what, file=stream)

    def __enter__(self) -> Step:
        return self.step

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def step(self, n: int) -> None:
        """So many more steps are done."""
        self._bar.update(n)

    def reach(self, done: int, total: int) -> None:
        """So many steps of so many are done."""
        self._bar.total = total
        self._bar.update(done - self._bar.n)


class Lines:
    """Lines for logs."""

    def __init__(self, what: str, total: int, stream: TextIO) -> None:
        self._what = what
        self._total = total
        self._stream = stream
        self._done = 0
        self._began = self._said = time.monotonic()

    def __enter__(self) -> Step:
        self._say("...")
        return self.step

    def __exit__(self, kind: object, *_: object) -> None:
        after = f"after {time.monotonic() - self._began:.1f} s"
        self._say(f"done {after}" if kind is None else f"broken off {after}")

    def step(self, n: int) -> None:
        """So many more steps are done."""
        self._done += n
        if time.monotonic() - self._said >= LINE_EVERY_S:
            share = f"{100 * self._done // self._total} % of {self._total}" if self._total else str(self._done)
            self._say(share)

    def reach(self, done: int, total: int) -> None:
        """So many steps of so many are done."""
        self._total = total
        self.step(done - self._done)

    def _say(self, text: str) -> None:
        self._said = time.monotonic()
        print(f"{self._what}: {text}", file=self._stream, flush=True)
