"""Choices, kept as long as a test process lives: the same history always gives the same choice, on either database."""

from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from typing import Any

import pytest

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.services import selection
from tidemap.spectral.auto.selection import Choice, choose


class KeptChoices:
    """`choose`, asked once for each history and what else it is asked by."""

    def __init__(self) -> None:
        self._kept: dict[tuple[object, ...], Choice] = {}

    def __call__(self, history: History, base: TimeBase, *asked: Any) -> Choice:
        *rest, check, calendar = asked
        planes = (history.observed, history.occupied, history.ended)
        digests = (None if plane is None else sha256(plane.tobytes()).digest() for plane in planes)
        key = (history.start, history.n_samples, history.n_cells, *digests, base, *rest, calendar)
        if key not in self._kept:
            self._kept[key] = choose(history, base, *asked)
        check()
        return self._kept[key]


@contextmanager
def kept_choices() -> Iterator[None]:
    """Within, updates of this process ask for each choice once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(selection, "choose", KeptChoices())
        yield
