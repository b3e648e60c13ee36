"""The parameters of the node; docs/ros2.md says what each means."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from rclpy.node import Node


@dataclass(frozen=True)
class Options:
    """Each field is a parameter with its default."""

    url: str = "http://127.0.0.1:8000"
    outbox: str = "tidemap-outbox.db"
    location: str = "lab"
    door: str = ""
    frame: str = "map"
    sigma_m: float = 0.04
    sigma_rad: float = 0.035
    max_range_m: float = 0.0
    scan_period_s: float = 1.0
    tf_wait_s: float = 1.0
    map_period_s: float = 30.0
    ahead_s: float = 0.0
    timeout_s: float = 10.0
    confidence: float = 0.0
    z_min: float = -1e6
    z_max: float = 1e6

    @classmethod
    def of(cls, node: "Node") -> "Options":
        """Declare them at a node, and read what it was started with."""
        values: dict[str, Any] = {
            name: node.declare_parameter(name, default).value for name, default in vars(cls()).items()
        }
        return cls(**values)

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """(6, 6) of a pose on the ground, None where nothing is said of it."""
        if not self.sigma_m and not self.sigma_rad:
            return None
        return np.diag([self.sigma_m, self.sigma_m, 0.0, 0.0, 0.0, self.sigma_rad]) ** 2
