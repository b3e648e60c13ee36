"""An occupancy grid as a numpy array, hour by hour for two weeks, and the map predicted for next Monday at ten.

Start a server first: `make run`.
"""

import numpy as np

from tidemap import Client

HOUR = 3600
MONDAY = 1767571200  # 2026-01-05T00:00:00Z
OCCUPIED, FREE, NOT_SEEN = 1, 0, -1

walls = np.full((20, 12), FREE, np.int8)
walls[[0, -1]] = walls[:, [0, -1]] = OCCUPIED
# The robot never sees this corner.
walls[15:, 8:] = NOT_SEEN


def seen(hour: int) -> "np.ndarray[tuple[int, int], np.dtype[np.int8]]":
    """A crate stands in the middle during working hours."""
    grid = walls.copy()
    grid[8:10, 5:7] = OCCUPIED if 8 <= hour % 24 < 17 else FREE
    return grid


with Client("http://127.0.0.1:8000") as tidemap:
    hall = tidemap.create_location(
        "numpy-hall", kind="grid2d", interval_s=HOUR, grid={"resolution_m": 0.5, "shape": [20, 12]}
    )
    for hour in range(14 * 24):
        hall.observe_grid(MONDAY + hour * HOUR, grid=seen(hour))
    hall.update()
    at_ten = hall.state(MONDAY + (14 * 24 + 10) * HOUR).dense()
    at_night = hall.state(MONDAY + (14 * 24 + 2) * HOUR).dense()
    print(f"crate at ten {at_ten[8, 5]:.2f}, at night {at_night[8, 5]:.2f}, corner {at_ten[18, 10]}")
