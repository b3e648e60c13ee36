"""A grid that takes seconds to update, filled by posts."""

from collections.abc import Sequence
from math import prod

import numpy as np

from tests.api.house import ARROW, arrow
from tests.support.site import Site

LOOKS = 10


def fill(site: Site, name: str, shape: Sequence[int]) -> int:
    """Create a location and post ten samples of all its cells, all of which change; how many measurements."""
    grid = {"frame": "map", "origin": [0, 0, 0], "resolution_m": 0.1, "shape": list(shape)}
    form = {"name": name, "kind": "grid3d", "interval_s": 60, "estimator": "fft", "order": 3, "grid": grid}
    assert site.http.post("/locations", json=form).status_code == 201
    cells = np.arange(prod(shape), dtype=np.uint32)
    for look in range(LOOKS):
        state = ((cells // 7 + look) % 3 == 0).astype(np.uint8)
        body = arrow({"time": np.full(len(cells), 1.7e9 + 60.0 * look), "cell": cells, "state": state})
        answer = site.http.post(f"/locations/{name}/observations", content=body, headers={"Content-Type": ARROW})
        assert answer.status_code == 201, answer.text
    return LOOKS * len(cells)
