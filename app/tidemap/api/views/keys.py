"""Keys as the API and the command show them."""

from tidemap.schemas.keys import Key, NewKey
from tidemap.services.keys import IssuedKey
from tidemap.storage.records import KeyRecord


def key_view(record: KeyRecord) -> Key:
    """A key without its secret."""
    return Key(**{name: getattr(record, name) for name in Key.model_fields})


def new_key_view(issued: IssuedKey) -> NewKey:
    """A new key with its secret."""
    return NewKey(**{name: getattr(issued, name) for name in NewKey.model_fields})
