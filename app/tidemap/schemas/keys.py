"""Keys on the wire."""

from typing import Literal

from pydantic import Field

from tidemap.schemas.common import Answer, Form, Text, TimeOut, shown

Role = Literal["robot", "operator", "admin"]


class KeyForm(Form):
    """A new key."""

    model_config = shown({"name": "cleaning robot 3", "role": "robot"})

    name: Text = Field(min_length=1, max_length=128)
    role: Role


class Key(Answer):
    """A key without its secret."""

    id: int
    name: str
    role: Role
    prefix: str
    created_at: TimeOut


class NewKey(Key):
    """A key with its secret, shown this once."""

    key: str
