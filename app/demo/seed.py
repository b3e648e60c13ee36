"""Three weeks of the building's life, posted through the public client."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import batched

import numpy as np

from app.client import Client
from app.demo.civil import DAY_S
from app.demo.locations import BUILDING, PLACES, prepare
from app.demo.progress import Progress, Silent
from app.demo.robot import INTERVAL_S, Look, Robot
from app.demo.story import planted
from app.demo.world import World
from app.schemas.anomalies import Event
from app.schemas.locations import Location

SEED = 2014
WEEKS_S = 21 * DAY_S
JUDGED_S = 3 * DAY_S
"""The last days are posted after the first model is there, so that they are judged by it."""
LEAD_S = 6 * 3600.0
LOOKS_AT_ONCE = 48
JUDGED_AT_ONCE = 12
