"""The example for ROS: its messages as rosbags writes and reads them, and its files as they say the same."""

import xml.etree.ElementTree as Xml
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tidemap_ros.messages import fill_map
from tidemap_ros.options import Options

from tests.support.bags import CLOUD, KINDS, LASER, MAP, START, BagWriter, bag
from tests.support.paths import ROOT
from tests.unit.importing.robot import FIRST, SCANS, STEP, cloud, ranges, written
from tidemap.api.scan_body import read_scan
from tidemap.client import ros
from tidemap.client.map_message import map_message
from tidemap.client.scanning import scan
from tidemap.formats.ros_messages import occupancy_states
from tidemap.formats.rosbag import Bag
from tidemap.formats.scan_body import ScanBody
from tidemap.ingest.scan import SentScan
from tidemap.schemas.locations import Grid

EXAMPLE = ROOT / "docs" / "examples" / "ros2"
PAGE = ROOT / "docs" / "ros2.md"
POSE = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def sent(message: Any) -> SentScan:
    """What the server reads of a message."""
    (batch,) = scan("/locations/lab", message, POSE, None, source=None, key=None).batches()
    return read_scan(ScanBody(batch.content, batch.content_type))


def test_scans_of_a_bag_are_their_arrays(tmp_path: Path, kind: str) -> None:
    with Bag(written(tmp_path, kind)) as opened:
        messages = [(each.topic.name, each.content) for each in opened.messages({LASER, CLOUD})]
    lasers = [sent(message) for topic, message in messages if topic == LASER]
    clouds = [sent(message) for topic, message in messages if topic == CLOUD]
    assert len(lasers) == len(clouds) == len(SCANS)
    for number, (laser, points) in enumerate(zip(lasers, clouds, strict=True)):
        np.testing.assert_array_equal(laser.ranges, ranges(number))
        header = laser.header
        assert (header.time, header.angle_min, header.range_max) == (SCANS[number], FIRST, 10.0)
        assert header.angle_increment == pytest.approx(STEP, abs=1e-9)
        np.testing.assert_array_equal(points.points, cloud(number))


def empty_map(writer: BagWriter) -> Any:
    """A message as a constructor of ROS makes it."""
    header = writer.header(0.0, "")
    origin = writer.pose(np.zeros(3), (0.0, 0.0, 0.0, 0.0))
    info = writer.make(
        "nav_msgs/MapMetaData", map_load_time=header.stamp, resolution=0.0, width=0, height=0, origin=origin
    )
    return writer.make("nav_msgs/OccupancyGrid", header=header, info=info, data=np.zeros(0, np.int8))


def test_a_map_goes_through_a_bag_and_back(tmp_path: Path, kind: str) -> None:
    grid = Grid(frame="floor", origin=(1.0, -2.0, 0.0), resolution_m=0.05, shape=[4, 3])
    percent = np.array([100, 0, -1, 100, 100, 0, 0, -1, 0, -1, 100, 0], np.int8)
    made = map_message(percent, grid, START + 0.25, "scale", -np.inf, np.inf)
    with bag(tmp_path, kind) as (path, writer):
        message: Any = fill_map(empty_map(writer), made)
        message.data = np.asarray(message.data)  # rosbags writes arrays of numpy, rclpy those of Python
        writer.write(MAP, message, START)
    with Bag(path) as opened:
        (read,) = (each.content for each in opened.messages({MAP}))
    geometry, state = occupancy_states(read)
    assert (geometry.frame, geometry.origin, geometry.resolution_m) == ("floor", (1.0, -2.0, 0.0), 0.05)
    assert geometry.shape == (4, 3)
    assert state.tolist() == np.select([percent == 100, percent == 0], [1, 0], 255).tolist()
    assert ros.Stamp(read.header.stamp.sec, read.header.stamp.nanosec) == ros.Stamp(START, 250_000_000)


def rows() -> dict[str, str]:
    """The parameters of the page with their defaults."""
    found: dict[str, str] = {}
    table = PAGE.read_text().split("## Parameters")[1].split("##")[0]
    for line in table.splitlines():
        if line.startswith("| `"):
            names, defaults = (cell.replace("`", "").split(",") for cell in line.split("|")[1:3])
            found |= dict(zip((each.strip() for each in names), (each.strip() for each in defaults), strict=True))
    return found


def test_page_and_file_have_all_parameters() -> None:
    defaults = vars(Options())
    assert rows() == {
        name: str(value).replace("-1000000.0", "-1e6").replace("1000000.0", "1e6") or "empty"
        for name, value in defaults.items()
    }
    file = yaml.safe_load((EXAMPLE / "config" / "tidemap.yaml").read_text())
    said = file["/**"]["ros__parameters"]
    assert said.keys() <= defaults.keys()
    assert {name: type(value) for name, value in said.items()} == {name: type(defaults[name]) for name in said}


def test_the_launch_file_remaps_what_the_node_has() -> None:
    launch = Xml.parse(EXAMPLE / "launch" / "tidemap.launch.xml").getroot()
    node = (EXAMPLE / "tidemap_ros" / "node.py").read_text()
    remapped = [each.attrib["from"] for each in launch.iter("remap")]
    assert len(remapped) == 4
    assert all(f'"{name}"' in node for name in remapped)
    declared = {each.attrib["name"] for each in launch.iter("arg")}
    used = {each.attrib["to"].removeprefix("$(var ").removesuffix(")") for each in launch.iter("remap")}
    assert used <= declared


@pytest.mark.parametrize(("sigma_m", "sigma_rad", "known"), [(0.0, 0.0, False), (0.1, 0.0, True), (0.0, 0.2, True)])
def test_a_pose_on_the_ground_moves_in_the_plane_alone(sigma_m: float, sigma_rad: float, known: bool) -> None:
    covariance = Options(sigma_m=sigma_m, sigma_rad=sigma_rad).covariance
    assert (covariance is not None) == known
    if covariance is not None:
        assert np.diag(covariance).tolist() == pytest.approx([sigma_m**2, sigma_m**2, 0, 0, 0, sigma_rad**2])
