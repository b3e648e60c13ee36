"""What the robot saw, on its way to the server: every location gets what it does not have yet."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.client import Client
from app.demo.locations import BUILDING, PLACES
from app.demo.robot import Look
from app.schemas.anomalies import Event
from app.schemas.locations import Location

SOURCE = "demo-robot"


@dataclass
class Posted:
    """What came of posting: `measurements` stored, and the anomalies found by their id."""

    measurements: int = 0
    anomalies: dict[int, Event] = field(default_factory=dict)


class Posting:
    """Posts looks of one robot in order of time; `last` is the time of the last at each location."""

    def __init__(self, client: Client, known: Mapping[str, Location]) -> None:
        self._client = client
        self.last = {name: location.last_time or 0.0 for name, location in known.items()}
        self.posted = Posted()

    def since(self) -> float:
        """All that was seen after this has to be posted somewhere."""
        return min(self.last.values())

    def post(self, looks: Iterable[Look]) -> None:
        """Post to every location the looks it does not have. Raises TidemapError."""
        seen = list(looks)
        self._building([look for look in seen if look.time > self.last[BUILDING]])
        for place in PLACES:
            self._place(place, [look for look in seen if look.time > self.last[place]])

    def _building(self, looks: Sequence[Look]) -> None:
        if looks:
            time = np.repeat([look.time for look in looks], [len(look.cell) for look in looks])
            state = np.concatenate([look.state for look in looks])
            cell = np.concatenate([look.cell for look in looks])
            self._observe(BUILDING, time, state, cell)

    def _place(self, place: str, looks: Sequence[Look]) -> None:
        if looks:
            time = np.array([look.time for look in looks])
            self._observe(place, time, np.array([look.places[place] for look in looks]), None)

    def _observe(
        self, name: str, time: NDArray[np.float64], state: NDArray[Any], cell: NDArray[np.uint32] | None
    ) -> None:
        stored = self._client.location(name).observe(time, state, cell, source=SOURCE)
        self.last[name] = float(time[-1])
        self.posted.measurements += stored.accepted
        self.posted.anomalies |= {event.id: event for event in stored.anomalies if event.id is not None}
