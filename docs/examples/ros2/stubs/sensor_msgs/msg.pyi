from collections.abc import Sequence

from std_msgs.msg import Header

class LaserScan:
    header: Header
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    ranges: Sequence[float]
    def __init__(self) -> None: ...

class PointCloud2:
    header: Header
