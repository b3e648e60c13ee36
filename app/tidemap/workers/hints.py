"""Hints: what one process sends the others of a message, short enough for the channel."""

from dataclasses import asdict, dataclass, fields
from typing import Any, get_args

import orjson

from tidemap.events.messages import EventMessage, Kind
from tidemap.storage.channel import MAX_TEXT_BYTES


@dataclass(frozen=True, slots=True)
class Hint:
    """That something happened in the process `origin`; `data` has of the message's what other processes cannot read
    from the rows."""

    origin: str
    kind: Kind
    location: str
    id: int
    time: float
    data: dict[str, Any]

    @classmethod
    def of(cls, origin: str, message: EventMessage) -> "Hint":
        """Of a message; an event is read from its row."""
        data = message.data
        if message.kind == "anomaly":
            data = {name: data[name] for name in ("update", "joined", "change") if name in data}
        return cls(origin, message.kind, message.location, message.id, message.time, data)

    @classmethod
    def read(cls, text: str) -> "Hint | None":
        """As it came through the channel; None where it is none that this version knows. Another may send more."""
        try:
            values = orjson.loads(text)
            hint = cls(**{each.name: values[each.name] for each in fields(cls)})
        except (ValueError, TypeError, KeyError):
            return None
        return hint if hint._is_sound() else None

    def text(self) -> str:
        """For the channel. What would be too long goes without its largest values, which are null then."""
        values = asdict(self)
        while len(encoded := orjson.dumps(values)) > MAX_TEXT_BYTES:
            largest = max(self.data, key=lambda name: len(orjson.dumps(values["data"][name])))
            values["data"][largest] = None
        return encoded.decode()

    def _is_sound(self) -> bool:
        known = self.kind in get_args(Kind) and isinstance(self.location, str) and isinstance(self.data, dict)
        return known and isinstance(self.id, int) and isinstance(self.time, int | float)

    def message(self) -> EventMessage:
        """The message, but for what was too long."""
        return EventMessage(self.kind, self.location, self.id, self.time, self.data)
