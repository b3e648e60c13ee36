"""OctoMap as an oracle: what its tree holds of one scan."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tidemap.space.grid import GridGeometry


def octomap_states(
    grid: GridGeometry, origin: NDArray[np.float64], points: NDArray[np.float64], max_range_m: float
) -> NDArray[np.int64]:
    """By cell (n_cells,): 1 occupied, 0 free, -1 not seen. The grid's faces are OctoMap's: multiples of the length."""
    pyoctomap = pytest.importorskip("pyoctomap", reason="OctoMap has no wheel for this machine")
    tree = pyoctomap.OcTree(grid.resolution_m)
    tree.insertPointCloud(points, origin, max_range_m)
    return np.asarray(tree.getLabels(grid.centre(np.arange(grid.n_cells))), np.int64)
