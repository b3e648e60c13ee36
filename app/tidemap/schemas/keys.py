"""Keys on the wire."""

from typing import Literal

from pydantic import Field

from tidemap.schemas.common import Answer, Form, Text, TimeIn, TimeOut, shown
from tidemap.schemas.patterns import LocationPatterns

Role = Literal["robot", "operator", "admin"]
MAX_OVERLAP_S = 90 * 86400.0


class KeyForm(Form):
    """A new key: of all locations or of some, for ever or until it expires."""

    model_config = shown(
        {"name": "cleaning robot 3", "role": "robot"},
        {
            "name": "display of floor 2",
            "role": "operator",
            "locations": ["hall", "floor-2-*"],
            "expires_at": "2030-01-01T00:00:00Z",
        },
    )

    name: Text = Field(min_length=1, max_length=128)
    role: Role
    locations: LocationPatterns | None = None
    expires_at: TimeIn | None = None


class RotationForm(Form):
    """How long the old secret still opens after a new one was made: not past the time when the key expires."""

    model_config = shown({"overlap_s": 3600})

    overlap_s: float = Field(86400.0, ge=0, le=MAX_OVERLAP_S)


class Key(Answer):
    """A key without its secret. `last_used_at` is exact to a minute, None of one that was never used."""

    id: int
    name: str
    role: Role
    prefix: str
    created_at: TimeOut
    locations: list[str] | None = None
    expires_at: TimeOut | None = None
    last_used_at: TimeOut | None = None


class NewKey(Key):
    """A key with its secret, shown this once."""

    key: str
