"""What a cell holds, however many there are and however they lie."""

from enum import Enum, auto


class ValueKind(Enum):
    """The kind of value that a cell has at every moment, and that is measured and modelled."""

    STATE = auto()
    """Occupied or free."""
