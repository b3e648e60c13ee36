"""Layers as data: what the cells of a grid are coloured by. Another one is another entry of `PREDICTED` or `OBSERVED`.

A layer is a table from what is known of a cell to a code of the palette: of predicted layers by verdict and
probability, or by the amplitude of p over the day; of observed ones by mark and age, of differences by what was seen
less what was expected.
"""

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tidemap.spectral.prediction import FREE_VERDICT, OCCUPIED_VERDICT, UNCERTAIN_VERDICT, entropy
from tidemap_web.viewer import colors
from tidemap_web.viewer.painting import (
    BY_AGE,
    BY_DAY,
    BY_DIFFERENCE,
    BY_MARK,
    BY_PROBABILITY,
    HIDDEN,
    LEVELS,
    MARKS,
    MISSING,
    OCCUPIED,
    STALE,
    SWING,
    UNEXPECTED,
)

PredictedName: TypeAlias = Literal["probability", "verdict", "entropy", "day"]
ObservedName: TypeAlias = Literal["seen", "age"]
LayoutName: TypeAlias = Literal["beside", "overlay", "difference"]
MINUTE_S, HOUR_S, DAY_S = 60.0, 3600.0, 86400.0
AGES_S: Final = (
    *(5 * MINUTE_S, 15 * MINUTE_S, HOUR_S, 3 * HOUR_S, 8 * HOUR_S),
    *(DAY_S, 3 * DAY_S, 7 * DAY_S, 28 * DAY_S),
)
"""Where ages of what was seen have another colour."""
NEAR: Final = 0.25
"""What was seen and is no further from what was expected is not shown as a difference."""
MIN_SWING: Final = 0.05
"""What has a lower amplitude over the day is not shown in that layer."""


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """source: what the table is indexed by; walls: whether what is always occupied may be grey in it."""

    source: int
    table: NDArray[np.uint16]
    walls: bool


def _by_probability(codes: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """The same for every verdict."""
    return np.tile(codes, 3)


def _verdicts() -> NDArray[np.uint16]:
    table = np.empty((3, LEVELS), np.uint16)
    for verdict, probability in ((FREE_VERDICT, 0.1), (UNCERTAIN_VERDICT, 0.5), (OCCUPIED_VERDICT, 1.0)):
        table[verdict] = colors.code_of_probability(np.array([probability]))[0]
    return table.ravel()


def _marks() -> NDArray[np.uint16]:
    table = np.full(MARKS, HIDDEN, np.uint16)
    table[OCCUPIED], table[STALE] = colors.CODE_OCCUPIED, colors.CODE_STALE
    table[UNEXPECTED], table[MISSING] = colors.CODE_UNEXPECTED, colors.CODE_MISSING
    return table


def _ages() -> NDArray[np.uint16]:
    """The newest brightest."""
    return colors.code_of_probability(np.linspace(1.0, 0.1, len(AGES_S) + 1))


def _differences() -> NDArray[np.uint16]:
    """Seen less expected, from -1 to 1."""
    difference = np.linspace(-1, 1, LEVELS)
    codes = colors.code_of_difference(difference)
    codes[np.abs(difference) <= NEAR] = HIDDEN
    return codes


def _days() -> NDArray[np.uint16]:
    """By the amplitude of p over a day, from 0 to `SWING`."""
    codes = colors.code_of_probability(_LEVEL)
    codes[_LEVEL * SWING < MIN_SWING] = HIDDEN
    return codes


_LEVEL = np.arange(LEVELS) / (LEVELS - 1)
PREDICTED: dict[PredictedName, Layer] = {
    "probability": Layer(BY_PROBABILITY, _by_probability(colors.code_of_probability(_LEVEL)), walls=True),
    "verdict": Layer(BY_PROBABILITY, _verdicts(), walls=True),
    "entropy": Layer(BY_PROBABILITY, _by_probability(colors.code_of_probability(entropy(_LEVEL))), walls=False),
    "day": Layer(BY_DAY, _days(), walls=True),
}
OBSERVED: dict[ObservedName, Layer] = {
    "seen": Layer(BY_MARK, _marks(), walls=True),
    "age": Layer(BY_AGE, _ages(), walls=False),
}
DIFFERENCE: Final = Layer(BY_DIFFERENCE, _differences(), walls=False)
OVERLAY_MARKS: Final = {UNEXPECTED: colors.CODE_UNEXPECTED, MISSING: colors.CODE_MISSING}
"""What an overlay shows of the observed grid, over the predicted one."""
