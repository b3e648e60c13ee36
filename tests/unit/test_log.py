"""Logging: what others say too much of is left out, unless everything is asked for."""

import json
import logging
import subprocess
import sys

import pytest

from tidemap.log import JsonFormatter, TextFormatter, request_id

SPEAK = """
import logging, sys
from tidemap.log import configure
configure(sys.argv[1], *sys.argv[2:])
logging.getLogger("httpx").info("asked")
logging.getLogger("sqlalchemy.pool.impl.QueuePool").error("Error closing cursor")
logging.getLogger("tidemap.storage.outage").error("the database cannot be read")
"""


@pytest.mark.parametrize(("level", "lines"), [("info", 1), ("debug", 3)])
def test_what_breaks_is_said_once(level: str, lines: int) -> None:
    spoken = subprocess.run([sys.executable, "-c", SPEAK, level], capture_output=True, text=True, check=True)
    assert len(spoken.stderr.splitlines()) == lines
    assert "ERROR   tidemap.storage.outage: the database cannot be read" in spoken.stderr


def record(message: str) -> logging.LogRecord:
    """A record of an error with a trace."""
    try:
        raise ValueError("a\rb")
    except ValueError:
        return logging.LogRecord("tidemap.x", logging.ERROR, __file__, 1, message, (), sys.exc_info())


def test_a_line_is_an_event_whatever_it_says() -> None:
    """A path that somebody asks for may hold the end of a line, and then what looks like another one."""
    said = TextFormatter().format(record("/a\r2026 ERROR all is lost\x1b[0m"))
    first, *trace = said.split("\n")
    assert first.endswith("ERROR   tidemap.x: /a")
    assert trace
    assert all(line.startswith("  ") for line in trace)
    assert said.replace("\n", "").isprintable()


def test_json_holds_everything_in_a_line() -> None:
    token = request_id.set("abc")
    try:
        said = JsonFormatter().format(record("broken\nin two"))
    finally:
        request_id.reset(token)
    assert "\n" not in said
    found = json.loads(said)
    assert found["message"] == "broken\nin two"
    assert (found["level"], found["request_id"]) == ("error", "abc")
    assert "ValueError" in found["trace"]
