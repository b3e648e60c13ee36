"""The commands `tidemap import` and `tidemap export`: files into a location, and the map out as a file."""

import argparse
import json
import sys
from dataclasses import asdict
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from tidemap.cli_support import (
    DONE,
    FAILED,
    UsageError,
    add_server,
    client_of,
    failed,
    positive_option,
    time_option,
)

if TYPE_CHECKING:
    from tidemap.client import MapFile, TidemapError
    from tidemap.importing.options import ImportOptions
    from tidemap.importing.run import Report

MAX_HITS = 100
"""As `space.rays.MAX_MIN_HITS`, which takes long to import."""
MIN_CLOCK = 1e8
"""Unix seconds of 1973: times before that count from the start of a recording."""


def add_files(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add both commands to a parser."""
    _add_import(commands)
    _add_export(commands)


def _add_import(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    command = commands.add_parser(
        "import",
        help="post what bags, logs, clouds, maps and tables hold",
        description="Reads everything first, and posts nothing unless all of it can be used. A run that was broken "
        "off goes on where it ended when it is started again: nothing is stored twice.",
    )
    command.add_argument("files", type=Path, nargs="+", metavar="FILE", help="files, bags and folders of clouds")
    command.add_argument("--location", metavar="NAME", help="the location; needed but for --dry-run")
    command.add_argument("--create", action="store_true", help="make the location from what is found, if it is missing")
    command.add_argument(
        "--dry-run", action="store_true", help="say what is found and propose a location; post nothing"
    )
    command.add_argument("--json", action="store_true", help="print one JSON object")
    add_server(command, "an operator")
    _add_meaning(command)
    command.set_defaults(command=_import)


def _add_meaning(command: argparse.ArgumentParser) -> None:
    """What says how files are understood."""
    moment = "Unix seconds, or ISO 8601 with a zone"
    command.add_argument("--topic", action="append", default=[], help="of a bag, to import; can be given often")
    command.add_argument("--fixed-frame", default="map", help="where poses are looked up in (default %(default)s)")
    command.add_argument("--robot-frame", default="base_link", help="whose poses those of --pose-topic are")
    command.add_argument("--pose-topic", action="append", default=[], help="of odometry or poses, beside tf")
    command.add_argument(
        "--poses", type=Path, metavar="CSV", help="poses of a folder of clouds (default: its poses.csv)"
    )
    command.add_argument("--skip-missing", action="store_true", help="leave out what has no pose")
    command.add_argument("--time", type=time_option, help=f"when a map was so, {moment} (default: its file's)")
    command.add_argument("--start", type=time_option, default=0.0, help=f"what second 0 of a log stands for, {moment}")
    command.add_argument("--time-column", default="time", help="of a table (default %(default)s)")
    command.add_argument("--state-column", default="state", help="of a table (default %(default)s)")
    command.add_argument("--occupied", action="append", default=[], help="a text that means occupied, others mean free")
    command.add_argument("--max-range", type=positive_option, default=inf, help="rays are cut off there, in metres")
    command.add_argument("--min-hits", type=_hits, default=1, help="hits that make a cell occupied (default 1)")
    command.add_argument("--resolution", type=positive_option, help="metres of a cell of a new location")
    command.add_argument("--interval", type=positive_option, default=60.0, help="seconds of a sample of a new location")
    command.add_argument("--time-zone", default="UTC", help="of a new location (default %(default)s)")


def _add_export(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    command = commands.add_parser("export", help="write the map at a time as a file that other programs load")
    command.add_argument("name", metavar="NAME", help="the location")
    command.add_argument("--format", required=True, choices=("nav2", "octomap", "ply", "pcd", "npz", "arrow"))
    command.add_argument("-o", "--output", type=Path, metavar="PATH", help="a file, or a folder (default: here)")
    command.add_argument("--overwrite", action="store_true", help="replace PATH if it is there")
    command.add_argument("--time", type=time_option, help="Unix seconds, or ISO 8601 with a zone (default: now)")
    command.add_argument("--source", default="predicted", choices=("predicted", "observed"))
    command.add_argument("--mode", default="trinary", choices=("trinary", "scale"), help="states, or probabilities")
    command.add_argument("--confidence", type=float, help="from which a cell is occupied (default: the location's)")
    command.add_argument("--z-min", type=float, help="lowest height of the band, in metres")
    command.add_argument("--z-max", type=float, help="highest height of the band, in metres")
    command.add_argument("--json", action="store_true", help="print JSON")
    add_server(command, "an operator")
    command.set_defaults(command=_export, needs_server=False)


def _hits(text: str) -> int:
    if not (text.isdecimal() and 1 <= int(text) <= MAX_HITS):
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 1 to {MAX_HITS}")
    return int(text)


def _import(arguments: argparse.Namespace) -> int:
    from tidemap.importing.run import survey_files
    from tidemap.progress import ShownProgress

    if arguments.location is None and not arguments.dry_run:
        raise UsageError("say --location NAME, or --dry-run to see what is in the files.")
    report = survey_files(arguments.files, _options(arguments), ShownProgress(sys.stderr))
    if arguments.dry_run:
        _show(report, arguments)
        return FAILED if report.problems else DONE
    return _post(report, arguments)


def _options(arguments: argparse.Namespace) -> "ImportOptions":
    from tidemap.importing.options import ImportOptions

    return ImportOptions(
        topics=tuple(arguments.topic),
        fixed_frame=arguments.fixed_frame,
        robot_frame=arguments.robot_frame,
        pose_topics=tuple(arguments.pose_topic),
        poses=arguments.poses,
        time=arguments.time,
        start=arguments.start,
        time_column=arguments.time_column,
        state_column=arguments.state_column,
        occupied=frozenset(each.strip().casefold() for each in arguments.occupied),
        max_range_m=arguments.max_range,
        min_hits=arguments.min_hits,
        skip_missing=arguments.skip_missing,
        resolution_m=arguments.resolution,
        interval_s=arguments.interval,
        time_zone=arguments.time_zone,
    )


def _show(report: "Report", arguments: argparse.Namespace) -> None:
    """What was found, and what would be made of it."""
    proposal = report.proposal and {"name": arguments.location, **report.proposal}
    if arguments.json:
        found = [each.described() for each in report.found]
        print(json.dumps({"found": found, "proposal": proposal, "problems": report.problems}))
        return
    for each in report.found:
        print(each)
    print(f"Location: {json.dumps(proposal)}" if proposal else "No location can be proposed.")
    for problem in report.problems:
        print(f"Problem: {problem}.")


def _post(report: "Report", arguments: argparse.Namespace) -> int:
    from tidemap.client import TidemapError
    from tidemap.importing.run import import_files
    from tidemap.progress import ShownProgress

    try:
        with client_of(arguments) as client:
            progress = ShownProgress(sys.stderr)
            tally = import_files(report, _options(arguments), client, arguments.location, arguments.create, progress)
    except TidemapError as error:
        return failed(f"{error}{_hint(error, report)}")
    if arguments.json:
        print(json.dumps({"location": arguments.location, **asdict(tally)}))
    else:
        dropped = f", {tally.dropped} older than the location keeps" if tally.dropped else ""
        print(f"{arguments.location}: {tally.stored} measurements stored, {tally.known} known before{dropped}")
    return DONE


def _hint(error: "TidemapError", report: "Report") -> str:
    """What option changes that the server refuses, as far as one does."""
    if error.type.endswith(":location-not-found"):
        return " --create makes it from what was found."
    if error.type.endswith(":invalid-input") and min(each.first for each in report.found) < MIN_CLOCK:
        return " The times count from the start of the recording: say with --start when that was."
    return ""


def _export(arguments: argparse.Namespace) -> int:
    from tidemap.client import TidemapError

    asked = {name: getattr(arguments, name) for name in ("source", "mode", "confidence", "z_min", "z_max")}
    try:
        with client_of(arguments) as client:
            file = client.location(arguments.name).export(arguments.format, arguments.time, **asked)
    except TidemapError as error:
        return failed(str(error))
    return _save(file, arguments)


def _save(file: "MapFile", arguments: argparse.Namespace) -> int:
    output: Path = arguments.output or Path()
    path = output / file.name if output.is_dir() else output
    try:
        with path.open("wb" if arguments.overwrite else "xb") as stream:
            stream.write(file.content)
    except FileExistsError:
        return failed(f"{path} is there already; choose another name, or say --overwrite.")
    except OSError as error:
        return failed(f"{path} cannot be written: {error.strerror}.")
    if file.unavailable:
        print(f"tidemap: cells {file.unavailable} are damaged at the server, and unknown in the file.", file=sys.stderr)
    if arguments.json:
        print(json.dumps({"file": str(path), "bytes": len(file.content), "time": file.time, "revision": file.revision}))
    else:
        print(f"{path}: {len(file.content):,} bytes")
    return DONE
