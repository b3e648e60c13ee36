"""How many connections are open, in all and from each address."""

from collections import Counter


class Census:
    """Counts open connections; used by one event loop.

    >>> census = Census(total=2, per_address=1)
    >>> census.enter("a"), census.enter("a"), census.enter("b"), census.enter("c")
    (True, False, True, False)
    >>> census.leave("a")
    >>> census.enter("c")
    True
    """

    def __init__(self, total: int, per_address: int) -> None:
        self._total = total
        self._per_address = per_address
        self._open: Counter[str] = Counter()
        self._count = 0

    def enter(self, address: str) -> bool:
        """Count a new connection; False where one of the limits is reached, and then it is not counted."""
        if self._count >= self._total or self._open[address] >= self._per_address:
            return False
        self._open[address] += 1
        self._count += 1
        return True

    def leave(self, address: str) -> None:
        """A counted connection has closed."""
        self._count -= 1
        self._open[address] -= 1
        if not self._open[address]:
            del self._open[address]
