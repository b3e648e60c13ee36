"""Logging: what others say too much of is left out, unless everything is asked for."""

import subprocess
import sys

import pytest

SPEAK = """
import logging, sys
from tidemap.log import configure
configure(sys.argv[1])
logging.getLogger("httpx").info("asked")
logging.getLogger("sqlalchemy.pool.impl.QueuePool").error("Error closing cursor")
logging.getLogger("tidemap.storage.outage").error("the database cannot be read")
"""


@pytest.mark.parametrize(("level", "lines"), [("info", 1), ("debug", 3)])
def test_what_breaks_is_said_once(level: str, lines: int) -> None:
    spoken = subprocess.run([sys.executable, "-c", SPEAK, level], capture_output=True, text=True, check=True)
    assert len(spoken.stderr.splitlines()) == lines
    assert "ERROR   tidemap.storage.outage: the database cannot be read" in spoken.stderr
