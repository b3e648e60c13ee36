from array import array
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

class PointField:
    def __init__(self, *, name: str, offset: int, datatype: int, count: int) -> None: ...

class PointCloud2:
    header: Header
    height: int
    width: int
    point_step: int
    row_step: int
    fields: Sequence[PointField]
    data: array[int]
    def __init__(self) -> None: ...
