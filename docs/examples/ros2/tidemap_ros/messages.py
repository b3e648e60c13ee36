"""What leaves for ROS, as its messages. What comes from ROS the client takes as it is."""

from array import array
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nav_msgs.msg import OccupancyGrid

    from tidemap.client import ros


def fill_map(message: "OccupancyGrid", grid: "ros.OccupancyGrid") -> "OccupancyGrid":
    """The same map in a message of nav_msgs: each of its numbers in the type that ROS checks for."""
    for stamp in (message.header.stamp, message.info.map_load_time):
        stamp.sec, stamp.nanosec = grid.header.stamp.sec, grid.header.stamp.nanosec
    message.header.frame_id = grid.header.frame_id
    message.info.resolution = grid.info.resolution
    message.info.width, message.info.height = grid.info.width, grid.info.height
    corner = grid.info.origin.position
    origin = message.info.origin
    origin.position.x, origin.position.y, origin.position.z = corner.x, corner.y, corner.z
    origin.orientation.w = 1.0
    message.data = array("b", grid.data.tobytes())
    return message
