"""Accuracy by order: the office week reconstructed, and the two later days predicted."""

from dataclasses import dataclass

from docs.paper.document import number
from docs.paper.recordings import SECONDS, history
from tests.support.office import Office, Signal
from tidemap.spectral.model import SpectralModel, accuracy, update
from tidemap.spectral.outliers import count, find_outliers

ORDERS = range(21)


@dataclass(frozen=True, slots=True)
class Row:
    """Accuracies (one minus Eq. 4) of one order, and the intervals in O."""

    order: int
    reconstruction: float
    day_1: float
    day_2: float
    intervals: int

    def cells(self) -> list[str]:
        """As printed."""
        shares = (self.reconstruction, self.day_1, self.day_2)
        return [str(self.order), *(number(share) for share in shares), str(self.intervals)]


def accuracies(office: Office) -> list[Row]:
    """Every order fitted to the week; 0.2 s each."""
    return [_row(office, order) for order in ORDERS]


def _row(office: Office, order: int) -> Row:
    model = update(history(office.week), "fft", order, SECONDS)
    intervals = int(model.outliers.start.size)
    return Row(order, accuracy(model), predicted(model, office.day_1), predicted(model, office.day_2), intervals)


def predicted(model: SpectralModel, day: Signal) -> float:
    """The accuracy of a model on a day it was not fitted to."""
    wrong = count(find_outliers(model.spectrum, history(day), SECONDS))
    return 1 - float(wrong[0]) / day.state.size
