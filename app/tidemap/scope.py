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

    def covers(self, other: "Scope") -> bool:
        """Whether all that is inside of another one is inside.

        >>> floor = Scope(("floor-2-*",))
        >>> [floor.covers(Scope((each,))) for each in ("floor-2-a", "floor-2-a*", "floor-*")], floor.covers(EVERYWHERE)
        ([True, True, False], False)
        """
        if self.patterns is None or other.patterns is None:
            return self.patterns is None
        begun = tuple(self.prefixes)
        return all(self.holds(name) for name in other.names) and all(
            begins.startswith(begun) if begun else False for begins in other.prefixes
        )

    def touches(self, other: "Scope") -> bool:
        """Whether a location may be inside of both.

        >>> floor = Scope(("floor-2-*",))
        >>> [floor.touches(Scope((each,))) for each in ("floor-2-a", "floor-*", "hall")], floor.touches(EVERYWHERE)
        ([True, True, False], True)
        """
        if self.patterns is None or other.patterns is None:
            return True
        return (
            any(self.holds(name) for name in other.names)
            or any(other.holds(name) for name in self.names)
            or any(one.startswith(two) or two.startswith(one) for one in self.prefixes for two in other.prefixes)
        )

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
