"""Keys as the API and the command show them."""

from typing import Any

from tidemap.schemas.keys import Key, NewKey
from tidemap.services.keys import IssuedKey
from tidemap.storage.records import KeyRecord


def key_view(record: KeyRecord) -> Key:
    """A key without its secret."""
    return Key(**_fields(record))


def new_key_view(issued: IssuedKey) -> NewKey:
    """A new key with its secret."""
    return NewKey(**_fields(issued), key=issued.key)


def _fields(record: KeyRecord) -> dict[str, Any]:
    named = {name: getattr(record, name) for name in Key.model_fields if hasattr(record, name)}
    patterns = record.scope.patterns
    return named | {"locations": None if patterns is None else list(patterns)}
