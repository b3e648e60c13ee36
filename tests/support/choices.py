"""Choices, kept as long as a test process lives: the same history always gives the same choice, on either database."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from hashlib import sha256

import pytest

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.services import selection
from tidemap.spectral.auto.selection import Choice, choose


class KeptChoices:
    """`choose`, asked once for each history and what else it is asked by."""

    def __init__(self) -> None:
        self._kept: dict[tuple[object, ...], Choice] = {}

    def __call__(
        self,
        history: History,
        base: TimeBase,
        orders: Sequence[int],
        max_cells: int,
        time_zone: str | None,
        estimator: str,
        check: Callable[[], None],
        calendar: str | None,
    ) -> Choice:
        planes = (history.observed, history.occupied, history.ended)
        digests = (None if plane is None else sha256(plane.tobytes()).digest() for plane in planes)
        asked = (tuple(orders), max_cells, time_zone, estimator, calendar)
        key = (history.start, history.n_samples, history.n_cells, *digests, base, *asked)
        if key not in self._kept:
            self._kept[key] = choose(history, base, orders, max_cells, time_zone, estimator, check, calendar)
        check()
        return self._kept[key]


@contextmanager
def kept_choices() -> Iterator[None]:
    """Within, updates of this process ask for each choice once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(selection, "choose", KeptChoices())
        yield
