"""Things in a room seen by a detector that errs: the state that is believed, against Perpetua's own example."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from docs.paper import recordings, style
from docs.paper.document import number, table
from tests.unit.spectral.filtering import Scores, filtered, learn, scores
from tests.unit.spectral.real import Things
from tidemap.history.history import UNOBSERVED
from tidemap.spectral.sensor import Sensor

NEEDS = recordings.ROOM
GIVEN = Sensor(miss=0.1, false_alarm=0.1)
HEADER = ("filter", "error rates", "run", "mean absolute error", "accuracy", "Brier", "calibration error")
# Perpetua's are of its authors' program with their log-normal prior; the others are filters of this data's README.
EARLIER = {
    ("Perpetua", "as its authors chose"): Scores(0.0115, 0.9902, 0.0084, 0.0065),
    ("chain of two states", "given"): Scores(0.0157, 0.9914, 0.0073, 0.0035),
    ("learned durations", "given"): Scores(0.0158, 0.9930, 0.0061, 0.0068),
}
SHOWN, WINDOW = 2, slice(12_000, 13_800)
"""A thing, and a quarter of an hour of half seconds."""


def make(images: Path) -> dict[str, str]:
    """Learned from three hours, scored on three others; and a quarter of an hour drawn."""
    past, now = recordings.room("train"), recordings.room("test")
    rows = [(*name, "earlier", found) for name, found in EARLIER.items()]
    for rates, given in (("given", GIVEN), ("learned", None)):
        together = filtered(learn(past, given), now)
        apart = np.concatenate([filtered(learn(past.of(i), given), now.of(i)) for i in range(len(now.truth))])
        rows.append(("here, one location for all", rates, "here", scores(together, now.truth)))
        rows.append(("here, a location for each", rates, "here", scores(apart, now.truth)))
    _draw(now, apart, images / "belief.png")
    return {"things": table(HEADER, [(name, rates, run, *_cells(found)) for name, rates, run, found in rows])}


def _cells(found: Scores) -> list[str]:
    each = (found.mean_absolute_error, found.accuracy, found.brier, found.calibration)
    return [number(value, 4) for value in each]


def _draw(now: Things, p: NDArray[np.float32], path: Path) -> None:
    """What was true, what was read and what is believed of one thing."""
    read, time_s = now.read.states()[SHOWN, WINDOW], np.arange(WINDOW.stop - WINDOW.start) / 2
    seen = read != UNOBSERVED
    with style.drawing(path, 3.2) as figure:
        axes = figure.subplots()
        axes.fill_between(time_s, now.truth[SHOWN, WINDOW], step="post", color=style.FAINT, label="true: there")
        axes.plot(time_s[seen], np.where(read[seen], 1.06, -0.06), "|", color=style.OBSERVED, label="read")
        axes.plot(time_s, p[SHOWN, WINDOW], color=style.PREDICTED, label="believed")
        axes.set(ylabel="probability", xlabel="seconds", xlim=(0, time_s[-1]))
        style.binary_axis(axes, ("0", "1"))
        style.legend_above(figure, axes)
