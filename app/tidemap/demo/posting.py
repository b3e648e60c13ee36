"""What the robot saw, on its way to the server: every location gets what it does not have yet."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.client import Client
from tidemap.demo.locations import BUILDING, LOCATIONS
from tidemap.demo.robot import RobotObservation
from tidemap.schemas.anomalies import Event
from tidemap.schemas.locations import Location

SOURCE = "demo-robot"


@dataclass
class Posted:
    """What came of posting: `measurements` stored, and the anomalies found by their id."""

    measurements: int = 0
    anomalies: dict[int, Event] = field(default_factory=dict)


class Posting:
    """Posts observations of one robot in order of time; `last` is the time of the last at each location."""

    def __init__(self, client: Client, known: Mapping[str, Location]) -> None:
        self._client = client
        self.last = {name: location.last_time or 0.0 for name, location in known.items()}
        self.posted = Posted()

    def since(self) -> float:
        """All that was seen after this has to be posted somewhere."""
        return min(self.last.values())

    def post(self, observations: Sequence[RobotObservation]) -> None:
        """Post observations at the building and at the locations in it. Raises TidemapError."""
        self.post_building(observations)
        self.post_locations([each.time for each in observations], [each.locations for each in observations])

    def post_building(self, observations: Sequence[RobotObservation]) -> None:
        """Post what was seen of the building, as columns in one batch or a few."""
        new = [observation for observation in observations if observation.time > self.last[BUILDING]]
        if new:
            time = np.repeat([observation.time for observation in new], [len(observation.cell) for observation in new])
            state = np.concatenate([observation.state for observation in new])
            self._observe(BUILDING, time, state, np.concatenate([observation.cell for observation in new]))

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
