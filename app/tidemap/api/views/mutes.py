"""Mutes as the API shows them."""

from tidemap.schemas.mutes import Mute
from tidemap.storage.records import MuteRecord


def mute_view(record: MuteRecord) -> Mute:
    """A mute."""
    named = {name: getattr(record, name) for name in Mute.model_fields if name != "locations"}
    patterns = record.scope.patterns
    return Mute(**named, locations=None if patterns is None else list(patterns))
