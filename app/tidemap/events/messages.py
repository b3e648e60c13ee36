"""Messages of the bus and of the WebSocket."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import orjson

from tidemap.schemas.common import iso

Kind = Literal["observation", "anomaly", "update", "job", "location", "attention"]
Attention = Literal["acknowledged", "snoozed", "muted", "unmuted"]
"""What somebody said of who is to hear of what: the `change` of a message of kind `attention`."""
TIMES = ("start", "stop", "acknowledged_at", "snoozed_until")
"""What is written as ISO 8601 of the data."""


@dataclass(frozen=True)
class EventMessage:
    """Something happened at a location. `id` numbers observations, anomalies, revisions, jobs, locations or mutes.

    Of a mute `location` is a pattern, as a scope has them.

    `data` adds to it: plain values, those of TIMES in Unix seconds.
    """

    kind: Kind
    location: str
    id: int
    time: float
    data: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def encoded(self) -> bytes:
        """As JSON; encoded once, however many readers there are."""
        return orjson.dumps(self.wire())

    @property
    def position(self) -> int:
        """Of an anomaly the number of this change: who resumes behind it hears of all later ones."""
        return int(self.data.get("change") or self.id)

    def wire(self) -> dict[str, Any]:
        """As it goes over the WebSocket."""
        times = {name: self.data[name] for name in TIMES if self.data.get(name) is not None}
        return {
            **self.data,
            **{name: iso(time_s) for name, time_s in times.items()},
            "kind": self.kind,
            "location": self.location,
            "id": self.id,
            "time": iso(self.time),
        }


def enveloped(kind: str, time: float, data: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a webhook, as Standard Webhooks has it."""
    return {"type": kind, "timestamp": iso(time), "data": data}
