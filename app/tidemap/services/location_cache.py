"""Location cache: the locations that were posted to lately, so that a post need not read before it is stored."""

import time
from collections import OrderedDict
from collections.abc import Callable

from tidemap.storage.records import LocationRecord

BELIEVED_S = 1.0
"""How long a record is taken for true; what this process changes is noticed at once."""
MOST = 10_000


class LocationCache:
    """Records by name, whose settings and revision are as they were a moment ago; their counters may be older.

    May be shared by threads.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, most: int = MOST) -> None:
        self._clock = clock
        self._most = most
        self._known: OrderedDict[str, tuple[float, LocationRecord]] = OrderedDict()

    def get(self, name: str, read: Callable[[str], LocationRecord]) -> LocationRecord:
        """The record of a name, as it is known or else as `read` has it, which raises where there is none."""
        # What is read goes where nobody looks any more if `forget` was called meanwhile.
        known = self._known
        until, record = known.get(name, (0.0, None))
        if record is not None and self._clock() < until:
            return record
        record = read(name)
        known[name] = (self._clock() + BELIEVED_S, record)
        if len(known) > self._most:
            known.popitem(last=False)
        return record

    def lately(self, name: str) -> LocationRecord | None:
        """The record of a name as it was when it was last read, which may be long ago."""
        _, record = self._known.get(name, (0.0, None))
        return record

    def forget(self) -> None:
        """Something about locations has changed."""
        self._known = OrderedDict()
