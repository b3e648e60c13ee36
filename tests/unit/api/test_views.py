"""Views: what services return, as it goes over the wire."""

import numpy as np
import pytest

from tidemap.api.views.anomalies import event_view, listed_view
from tidemap.services import listing
from tidemap.services.anomalies import Anomaly
from tidemap.services.messages import anomaly_message

ACKNOWLEDGED = Anomaly(
    id=7,
    location="lab",
    start=60.0,
    stop=120.5,
    cells=np.array([3, 5, 8]),
    cells_total=3,
    bbox=(0.5, 0.0, 0.0, 1.5, 1.0, 0.5),
    observed=1,
    probability=0.02,
    surprise=0.99,
    confidence=0.9,
    rule="surprise",
    revision=4,
    acknowledged_by="ann",
    acknowledged_at=3600.0,
    note="a cat",
)
OF_A_DOOR = Anomaly(
    8, "door", 0.0, 60.0, np.array([0]), 1, None, 0, 1.0, 1.0, 0.95, "surprise", 1, None, None, None
)  # fmt: skip


def test_an_event_has_all_of_its_cells_and_a_list_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "MAX_CELLS", 2)
    assert (event_view(ACKNOWLEDGED).cells, event_view(ACKNOWLEDGED).cells_total) == ([3, 5, 8], 3)
    assert (listed_view(ACKNOWLEDGED).cells, listed_view(ACKNOWLEDGED).cells_total) == ([3, 5], 3)


@pytest.mark.parametrize("event", [ACKNOWLEDGED, OF_A_DOOR], ids=["grid", "state"])
def test_a_message_says_of_an_event_what_lists_do(event: Anomaly, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "MAX_CELLS", 2)
    message = anomaly_message(event, 1e9)
    assert message.data == listed_view(event).model_dump(mode="json")
    assert (message.kind, message.location, message.id, message.time) == ("anomaly", event.location, event.id, 1e9)
