"""Things in a room seen by a detector that errs: the state that is believed, against Perpetua's own example."""

import numpy as np
import pytest

from tests.unit.spectral.filtering import filtered, learn, scores
from tests.unit.spectral.real import room
from tidemap.spectral.sensor import Sensor

PERPETUA_BRIER, PERPETUA_ACCURACY = 0.0084, 0.9902
GIVEN = Sensor(miss=0.1, false_alarm=0.1)
EVERY = 7
"""One of so many samples is scored."""


@pytest.mark.parametrize("given", [GIVEN, None], ids=["rates given", "rates learned"])
def test_every_thing_a_location_of_its_own(given: Sensor | None) -> None:
    past, now = room("train"), room("test")
    p = [filtered(learn(past.of(thing), given), now.of(thing), EVERY) for thing in range(8)]
    found = scores(np.concatenate(p), now.truth[:, ::EVERY])
    assert found.brier <= 0.0058 < PERPETUA_BRIER
    assert found.accuracy >= 0.9925 > PERPETUA_ACCURACY


@pytest.mark.parametrize("given", [GIVEN, None], ids=["rates given", "rates learned"])
def test_all_things_cells_of_one_location(given: Sensor | None) -> None:
    past, now = room("train"), room("test")
    learned = learn(past, given)
    found = scores(filtered(learned, now, EVERY), now.truth[:, ::EVERY])
    assert found.brier <= 0.0070
    assert found.accuracy >= 0.992
    assert learned.detector.sensor.miss == pytest.approx(0.1, abs=0.01)
    assert learned.detector.sensor.false_alarm == pytest.approx(0.1, abs=0.01)
