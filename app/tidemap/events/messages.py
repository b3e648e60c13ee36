"""Messages of the bus and of the WebSocket."""

from dataclasses import dataclass, field
from typing import Any, Literal

from tidemap.schemas.common import iso

Kind = Literal["observation", "anomaly", "update", "job"]


@dataclass(frozen=True, slots=True)
class EventMessage:
    """Something happened at a location. `id` numbers observations, anomalies, revisions or jobs; `data` adds to it."""

    kind: Kind
    location: str
    id: int
    time: float
    data: dict[str, Any] = field(default_factory=dict)

    def wire(self) -> dict[str, Any]:
        """As it goes over the WebSocket."""
        return {
            **self.data,
            "kind": self.kind,
            "location": self.location,
            "id": self.id,
            "time": iso(self.time),
        }
