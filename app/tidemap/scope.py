"""Scope: which locations a key may see, or a webhook is for."""

import json
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Scope:
    """Locations by `patterns`: names, or what names begin with and a `*`. None: all locations.

    >>> floor = Scope(("hall", "floor-2-*"))
    >>> [floor.holds(name) for name in ("hall", "hall-2", "floor-2-door", "Floor-2-door")]
    [True, False, True, False]
    """

    patterns: tuple[str, ...] | None = None

    @property
    def limited(self) -> bool:
        """Whether some location may be outside."""
        return self.patterns is not None

    @property
    def names(self) -> list[str]:
        """The names that are given whole."""
        return [each for each in self.patterns or () if not each.endswith("*")]

    @property
    def prefixes(self) -> list[str]:
        """What other names begin with."""
        return [each[:-1] for each in self.patterns or () if each.endswith("*")]

    def holds(self, name: str) -> bool:
        """Whether a location is inside."""
        return self.patterns is None or name in self.names or name.startswith(tuple(self.prefixes))

    def dumped(self) -> str | None:
        """As it is stored."""
        return None if self.patterns is None else json.dumps(self.patterns)

    @classmethod
    def loaded(cls, stored: str | None) -> "Scope":
        """From what is stored."""
        return EVERYWHERE if stored is None else cls(tuple(json.loads(stored)))

    @classmethod
    def of(cls, patterns: list[str] | None) -> "Scope":
        """From what somebody sent."""
        return EVERYWHERE if patterns is None else cls(tuple(patterns))


EVERYWHERE = Scope()
