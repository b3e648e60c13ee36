"""Rows as repositories take them."""

from typing import Any

from tests.support.contexts import NOW

VALUES: dict[str, Any] = {
    "name": "door",
    "kind": "state",
    "interval_s": 60.0,
    "time_zone": "Europe/London",
    "epoch": 0.5,
    "grid": None,
    "estimator": "auto",
    "order": None,
    "confidence": 0.9,
    "missing": "mask",
    "hold_s": None,
    "retention_s": None,
    "min_cells": 1,
    "created_at": NOW,
}
"""A location of kind `state`."""
