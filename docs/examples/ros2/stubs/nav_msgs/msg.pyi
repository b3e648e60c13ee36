from array import array

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose
from std_msgs.msg import Header

class MapMetaData:
    map_load_time: Time
    resolution: float
    width: int
    height: int
    origin: Pose

class OccupancyGrid:
    header: Header
    info: MapMetaData
    data: array[int]
    def __init__(self) -> None: ...
