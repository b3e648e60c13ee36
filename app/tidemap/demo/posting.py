"""What the robot saw, on its way to the server: every location gets what it does not have yet."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.client import Client
from tidemap.demo.locations import BUILDING, LOCATIONS
from tidemap.demo.robot import Look
from tidemap.schemas.anomalies import Event
from tidemap.schemas.locations import Location

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

    def post(self, looks: Sequence[Look]) -> None:
        """Post looks at the building and at the locations in it. Raises TidemapError."""
        self.post_building(looks)
        self.post_locations([look.time for look in looks], [look.locations for look in looks])

    def post_building(self, looks: Sequence[Look]) -> None:
        """Post what was seen of the building, as columns in one batch or a few."""
        new = [look for look in looks if look.time > self.last[BUILDING]]
        if new:
            time = np.repeat([look.time for look in new], [len(look.cell) for look in new])
            state = np.concatenate([look.state for look in new])
            self._observe(BUILDING, time, state, np.concatenate([look.cell for look in new]))

    def post_locations(self, time: Sequence[float], seen: Sequence[Mapping[str, bool]]) -> None:
        """Post the states of the locations, seen at times (n,)."""
        for location in LOCATIONS:
            new = np.asarray(time) > self.last[location]
            if new.any():
                state = np.array([each[location] for each in seen])
                self._observe(location, np.asarray(time)[new], state[new], None)

    def _observe(
        self, name: str, time: NDArray[np.float64], state: NDArray[Any], cell: NDArray[np.uint32] | None
    ) -> None:
        stored = self._client.location(name).observe(time, state, cell, source=SOURCE)
        self.last[name] = float(time[-1])
        self.posted.measurements += stored.accepted
        self.posted.anomalies |= {event.id: event for event in stored.anomalies if event.id is not None}
