"""Mutes on the wire."""

from pydantic import Field

from tidemap.schemas.common import Answer, Form, Text, TimeIn, TimeOut, shown
from tidemap.schemas.patterns import LocationPatterns


class MuteForm(Form):
    """Nobody is to hear of events in [start, stop) at some locations (default: all that the key may see).

    `weekly`: nor at the same time of any later week, by the clock of the location's time zone, until `until`.
    """

    model_config = shown(
        {
            "locations": ["hall", "floor-2-*"],
            "start": "2026-03-07T10:00:00Z",
            "stop": "2026-03-07T12:00:00Z",
            "weekly": True,
            "note": "The cleaners.",
        }
    )

    locations: LocationPatterns | None = None
    start: TimeIn
    stop: TimeIn
    weekly: bool = False
    until: TimeIn | None = None
    note: Text = Field("", max_length=2000)


class Mute(Answer):
    """A time in which nobody hears of the events of some locations, and who wants that."""

    id: int
    locations: list[str] | None
    start: TimeOut
    stop: TimeOut
    weekly: bool
    until: TimeOut | None
    note: str
    created_by: str
    created_at: TimeOut
