"""Owners: which of the measurements of a compacted history are those of one source, as far as that can be told."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError
from tidemap.history.combining import MAJORITY
from tidemap.storage.repositories.sources import UNKNOWN, Stint

_WORDS = {UNKNOWN: "robots that are not known any more", "": "robots without a name"}


class Owners:
    """What stands in a history has the time of its observation: it is of the source that alone measured then."""

    def __init__(self, stints: Sequence[Stint], source: str, combine: str) -> None:
        self._source = source
        self._mine = [stint for stint in stints if stint.name in (source, UNKNOWN)]
        self._others = [stint for stint in stints if stint.name != source]
        self._mixed = combine == MAJORITY

    def own(self, time: NDArray[np.float64], asked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which of the times (n,) are of the source.

        Raises InvalidInputError where some of those that are `asked` for (n,) may be of others, too; for `majority`,
        which counts what all of them say, where others measured at all.
        """
        mine, others = _covered(time, self._mine), _covered(time, self._others)
        unclear = asked & mine if self._mixed and self._others else asked & mine & others
        if unclear.any():
            raise self._inseparable()
        return mine

    def _inseparable(self) -> InvalidInputError:
        names = ", ".join(_WORDS.get(name, repr(name)) for name in sorted({stint.name for stint in self._others}))
        return InvalidInputError.at(
            "source",
            f"what {self._source!r} measured between start and stop is compacted together with what was measured by "
            f"{names}, and cannot be told apart any more; choose a time in which it was alone, or leave `source` out "
            "to delete all of it",
        )


def _covered(time: NDArray[np.float64], stints: Sequence[Stint]) -> NDArray[np.bool_]:
    """Which of the times lie in some stint."""
    begun = np.searchsorted(np.sort([stint.first_time for stint in stints]), time, "right")
    ended = np.searchsorted(np.sort([stint.last_time for stint in stints]), time, "left")
    return np.asarray(begun > ended)
