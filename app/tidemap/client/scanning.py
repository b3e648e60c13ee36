"""Posting scans."""

import hashlib
import json
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.client import npy, ros
from tidemap.client.plans import Plan, ask
from tidemap.client.posting import Batch
from tidemap.client.requests import present
from tidemap.client.times import TimeLike, unix
from tidemap.media_types import JSON, MULTIPART, NPY
from tidemap.schemas.ros import cloud_points
from tidemap.schemas.scans import ScanAccepted


@dataclass(frozen=True, slots=True, eq=False)
class ScanPost:
    """A scan for the location at `path`: its header, and beside it `points` (n, 2 or 3) or `ranges` (n,) by name."""

    path: str
    header: Mapping[str, Any]
    part: str
    values: NDArray[np.float32]
    source: str | None
    key: str

    def batches(self) -> Iterator[Batch]:
        """One."""
        content_type, content = multipart(self.header, self.part, self.values)
        yield Batch(self.path, present(source=self.source), content_type, content, self.key, len(self.values))

    def plan(self) -> Plan[ScanAccepted]:
        """Post it."""
        (batch,) = self.batches()
        return (yield from ask(ScanAccepted, batch.request()))


def scan(
    path: str,
    scan: Any,
    map_from_sensor: Any,
    time: TimeLike | None,
    *,
    source: str | None,
    key: str | None,
    **said: Any,
) -> ScanPost:
    """A scan for the location at `path`, with `key` or a new one; what is `said` goes into the header.

    Raises ValueError for what is no scan, and without a time.
    """
    header = present(**said, map_from_sensor=ros.pose_of(map_from_sensor))
    if "covariance" in header:
        header["covariance"] = np.asarray(header["covariance"], np.float64).reshape(6, 6).tolist()
    part, values, more = _measured(scan)
    stamp = getattr(getattr(scan, "header", None), "stamp", None) if time is None else time
    if stamp is None:
        raise ValueError("give the time of the scan, or a message with a stamp")
    return ScanPost(path, {**more, **header, "time": unix(stamp)}, part, values, source, key or uuid.uuid4().hex)


def _measured(scan: Any) -> tuple[str, NDArray[np.float32], dict[str, float]]:
    """The name of the part, its values, and what the header says of them."""
    if ros.is_laser_scan(scan):
        names = ("angle_min", "angle_increment", "range_min", "range_max")
        said = {name: float(value) for name in names if (value := getattr(scan, name, None)) is not None}
        if said["range_max"] == np.inf:
            del said["range_max"]
        return "ranges", np.asarray(scan.ranges, np.float32), said
    points = cloud_points(scan) if ros.is_point_cloud(scan) else np.asarray(scan)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or points.dtype.kind not in "fiu":
        raise ValueError(
            f"points are an array (n, 3), or (n, 2) of a planar sensor; this has the shape {points.shape} "
            f"and the type {points.dtype}"
        )
    return "points", points.astype(np.float32), {}


def multipart(header: Mapping[str, Any], part: str, values: NDArray[np.float32]) -> tuple[str, bytes]:
    """The Content-Type and the body of a scan; the same for the same scan."""
    said, array = json.dumps(header, allow_nan=False).encode(), npy.write(values)
    digest = hashlib.blake2b(said + array, digest_size=16).hexdigest()
    boundary = f"tidemap-{digest}"
    pieces = [_part(boundary, "header", JSON), said, _part(boundary, part, NPY), array, f"--{boundary}--\r\n".encode()]
    return f"{MULTIPART}; boundary={boundary}", b"".join([*pieces[:2], b"\r\n", *pieces[2:4], b"\r\n", pieces[4]])


def _part(boundary: str, name: str, media_type: str) -> bytes:
    """What stands before a part."""
    return (
        f'--{boundary}\r\nContent-Disposition: form-data; name="{name}"\r\nContent-Type: {media_type}\r\n\r\n'
    ).encode()
