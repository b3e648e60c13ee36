"""Views: what services return, as it goes over the wire."""

from dataclasses import replace

import numpy as np
import pytest

from tidemap.api.views.anomalies import event_view, listed_view
from tidemap.services import listing
from tidemap.services.anomalies import Anomaly
from tidemap.services.messages import anomaly_message

ACKNOWLEDGED = Anomaly(
    location_id=2,
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
    location_id=1,
    id=8,
    location="door",
    start=0.0,
    stop=60.0,
    cells=np.array([0]),
    cells_total=1,
    bbox=None,
    observed=0,
    probability=1.0,
    surprise=1.0,
    confidence=0.95,
    rule="surprise",
    revision=1,
)


def test_an_event_has_all_of_its_cells_and_a_list_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "MAX_CELLS", 2)
    assert (event_view(ACKNOWLEDGED).cells, event_view(ACKNOWLEDGED).cells_total) == ([3, 5, 8], 3)
    assert (listed_view(ACKNOWLEDGED).cells, listed_view(ACKNOWLEDGED).cells_total) == ([3, 5], 3)


@pytest.mark.parametrize("event", [ACKNOWLEDGED, OF_A_DOOR], ids=["grid", "state"])
def test_a_message_says_of_an_event_what_lists_do(event: Anomaly, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "MAX_CELLS", 2)
    message = anomaly_message(event, 1e9)
    head = {"kind": "anomaly", "location": event.location, "id": event.id, "time": "2001-09-09T01:46:40Z"}
    assert message.wire() == listed_view(event).model_dump(mode="json") | head
    assert (message.kind, message.location, message.id, message.time) == ("anomaly", event.location, event.id, 1e9)


def test_an_event_that_is_not_stored_has_no_id() -> None:
    assert event_view(replace(OF_A_DOOR, id=0)).id is None
