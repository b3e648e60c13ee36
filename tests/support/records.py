"""Records as the database would give them, for tests without one."""

from typing import Any

from tidemap.storage.records import LocationRecord


def location_record(**values: Any) -> LocationRecord:
    """A location of kind `state` that nothing was posted to, but for what is said."""
    plain: dict[str, Any] = {
        "id": 1,
        "name": "lab",
        "kind": "state",
        "interval_s": 60.0,
        "time_zone": "UTC",
        "epoch": 0.0,
        "grid": None,
        "estimator": "auto",
        "order": None,
        "confidence": 0.9,
        "missing": "mask",
        "combine": "latest",
        "hold_s": None,
        "retention_s": None,
        "min_cells": 1,
        "calendar": None,
        "pose": None,
        "created_at": 0.0,
        "observation_seq": 0,
        "compacted_seq": 0,
        "measurements": 0,
        "deleted": 0,
        "first_time": None,
        "last_time": None,
        "revision": 1,
    }
    return LocationRecord(**(plain | values))
