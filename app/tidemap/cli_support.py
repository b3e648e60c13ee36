"""What commands share: how they end, where the database or the server is."""

import argparse
import os
import sys
from math import inf, nan
from pathlib import Path
from typing import TYPE_CHECKING

from tidemap import log

if TYPE_CHECKING:
    from tidemap.client import Client
    from tidemap.settings import Settings

DONE, FAILED, WRONG_USAGE = 0, 1, 2
MAX_COUNT, MAX_PORT = 10**9, 65535


class UsageError(Exception):
    """A command was called wrongly; the message says how."""


def failed(message: str) -> int:
    """Say why a command failed; its exit status."""
    print(f"tidemap: {message}", file=sys.stderr)
    return FAILED


def add_database(command: argparse.ArgumentParser) -> None:
    """The options that say where the database is."""
    where = command.add_mutually_exclusive_group()
    where.add_argument("--data", type=Path, help="folder of the embedded database (default ./data)")
    where.add_argument("--database-url", help="postgresql+psycopg://… instead of the embedded database")


def client_of(arguments: argparse.Namespace) -> "Client":
    """A client of the server that the options name. Raises UsageError for an address or a key that is none."""
    from tidemap.client import Client

    try:
        return Client(arguments.url, key=arguments.key)
    except ValueError as error:
        raise UsageError(str(error)) from None


def add_server(command: argparse.ArgumentParser, who: str) -> None:
    """The options that say where a server is and whose key is sent."""
    command.add_argument("--url", default="http://127.0.0.1:8000", help="the server (default %(default)s)")
    command.add_argument("--key", default=os.environ.get("TIDEMAP_KEY"), help=f"{who}'s key (default: TIDEMAP_KEY)")


def add_json(command: argparse.ArgumentParser) -> None:
    """The option of what a script may want to read."""
    command.add_argument("--json", action="store_true", help="print JSON")


def positive_option(text: str) -> float:
    """A positive number of an option."""
    if not 0 < (value := _number(text)) < inf:
        raise argparse.ArgumentTypeError(f"{text!r} is no positive number")
    return value


def duration_option(text: str) -> float:
    """Seconds of an option, 0 or more."""
    if not 0 <= (value := _number(text)) < inf:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds from 0 on")
    return value


def _number(text: str) -> float:
    """NaN, which lies in no range, where it is none."""
    try:
        return float(text)
    except ValueError:
        return nan


def count_option(text: str) -> int:
    """A positive whole number of an option."""
    if not (text.isascii() and text.isdecimal() and 0 < int(text) <= MAX_COUNT):
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 1 to {MAX_COUNT}")
    return int(text)


def port_option(text: str) -> int:
    """A port of an option."""
    if not (text.isascii() and text.isdecimal() and int(text) <= MAX_PORT):
        raise argparse.ArgumentTypeError(f"{text!r} is no port: give a number from 0 to {MAX_PORT}")
    return int(text)


def time_option(text: str) -> float:
    """Unix seconds of an option: ISO 8601 with a zone, or a number."""
    from tidemap.schemas.common import parse_time_text

    try:
        return parse_time_text(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def settings_of(arguments: argparse.Namespace) -> "Settings":
    """The settings of a command: what its options say, else the environment."""
    from tidemap.settings import Settings

    names = Settings.model_fields.keys() & vars(arguments).keys()
    given = {name: getattr(arguments, name) for name in names if getattr(arguments, name) is not None}
    settings = Settings(**given)
    log.configure(settings.log_level, settings.log_format)
    return settings


def existing_settings(arguments: argparse.Namespace) -> "Settings":
    """The settings of a command that makes no database. Raises DatabaseUnusableError where there is none."""
    from tidemap.storage.store import require_database

    settings = settings_of(arguments)
    require_database(settings.url)
    return settings
