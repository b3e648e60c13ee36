"""Answers as tables of CSV, for people and their spreadsheets."""

from datetime import datetime
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray
from starlette.responses import Response

from tidemap.formats import csv
from tidemap.history.history import UNOBSERVED
from tidemap.media_types import CSV
from tidemap.services.series import SeriesView


def series_table(view: SeriesView) -> Response:
    """One cell over time: Unix seconds, and the same by the location's clock; what is unknown is empty."""
    zone = ZoneInfo(view.time_zone)
    content = csv.write(
        {
            "time_s": view.time.tolist(),
            "local_time": [datetime.fromtimestamp(time, zone).isoformat() for time in view.time.tolist()],
            "time_zone": [view.time_zone] * len(view.time),
            "cell": [view.cell] * len(view.time),
            "probability": _known(view.probability.astype(np.float64).round(6), np.isnan(view.probability)),
            "state": _known(view.state, view.state == UNOBSERVED),
            "observed": _known(view.observed, view.observed == UNOBSERVED),
        }
    )
    headers = {
        "Content-Disposition": f'attachment; filename="{view.name}-{view.cell}.csv"',
        "Tidemap-Revision": str(view.revision),
    }
    return Response(content, media_type=f"{CSV}; charset=utf-8; header=present", headers=headers)


def _known(values: NDArray[np.float64] | NDArray[np.uint8], missing: NDArray[np.bool_]) -> list[float | None]:
    return [None if unknown else value for value, unknown in zip(values.tolist(), missing.tolist(), strict=True)]
