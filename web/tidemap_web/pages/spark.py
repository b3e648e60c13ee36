"""Sparklines: a day behind and a day ahead in the height of a line of text, as the path of an SVG."""

import numpy as np
from numpy.typing import ArrayLike

HEIGHT = 20
"""Of a probability of 1, in units of the SVG; a value is a unit wide."""


def path(probability: ArrayLike) -> str:
    """A path from left to right, broken where a value is NaN; straight pieces are one segment.

    >>> path([0, 0, 0, 1, 1, float("nan"), 0.5])
    'M0 20h2l1-20h1M6 10'
    """
    values = np.asarray(probability, np.float64)
    level = np.where(np.isnan(values), -1, np.round((1 - values) * HEIGHT)).astype(int).tolist()
    parts: list[str] = []
    run: tuple[int, int] | None = None  # how wide, and how far down each unit goes
    for x, (before, y) in enumerate(zip([-1, *level], level, strict=False)):
        if y < 0 or before < 0:
            parts += [_segment(run)] if run else []
            parts += [f"M{x} {y}"] if y >= 0 else []
            run = None
        elif run and run[1] == y - before:
            run = (run[0] + 1, run[1])
        else:
            parts += [_segment(run)] if run else []
            run = (1, y - before)
    return "".join([*parts, *([_segment(run)] if run else [])])


def _segment(run: tuple[int, int]) -> str:
    width, slope = run
    down = width * slope
    return f"h{width}" if down == 0 else f"l{width}{'' if down < 0 else ' '}{down}"
