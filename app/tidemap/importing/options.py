"""Options: how files are understood."""

from dataclasses import dataclass
from math import inf, nan
from pathlib import Path

OCCUPIED_WORDS = frozenset({"1", "1.0", "true", "occupied", "open", "on", "yes"})
FREE_WORDS = frozenset({"0", "0.0", "false", "free", "closed", "off", "no"})
UNAVAILABLE_WORDS = frozenset({"unavailable", "unknown", "null", "none", "nan"})
"""As home automation and data frames write that a sensor does not know the state; they write 1.0 for 1 then."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """All of them have a default that suits most files.

    topics: of a bag, those that are read; by default the one that can be. fixed_frame: what poses are looked up in.
    pose_topics: odometry or poses of `robot_frame`. poses: the table of a folder of clouds. time: of a map that has
    none, Unix seconds; by default when its file was changed. start: what second 0 of a log stands for, Unix seconds.
    occupied: the texts that mean occupied, all others but `UNAVAILABLE_WORDS` then mean free; by default
    `OCCUPIED_WORDS` and `FREE_WORDS`.
    skip_missing: leave out what has no pose. resolution_m, interval_s, time_zone: of a location that is proposed.
    """

    topics: tuple[str, ...] = ()
    fixed_frame: str = "map"
    robot_frame: str = "base_link"
    pose_topics: tuple[str, ...] = ()
    poses: Path | None = None
    time: float | None = None
    start: float = 0.0
    time_column: str = "time"
    state_column: str = "state"
    occupied: frozenset[str] = frozenset()
    max_range_m: float = inf
    min_hits: int = 1
    skip_missing: bool = False
    resolution_m: float | None = None
    interval_s: float = 60.0
    time_zone: str = "UTC"

    def state_of(self, text: str) -> float:
        """1 for a text that means occupied, 0 for free, NaN for unavailable or none. Raises ValueError for others."""
        word = text.strip().casefold()
        if word in UNAVAILABLE_WORDS and word not in self.occupied:
            return nan
        if self.occupied:
            return int(word in self.occupied)
        if not word:
            return nan
        if word not in OCCUPIED_WORDS and word not in FREE_WORDS:
            raise ValueError(f"{text[:40]!r} is neither occupied nor free; name what is occupied with --occupied")
        return int(word in OCCUPIED_WORDS)
