"""The command `tidemap`."""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from socket import socket
from typing import TYPE_CHECKING

from pydantic import ValidationError

from tidemap import log
from tidemap.cli_completion import add_completion
from tidemap.cli_files import add_files
from tidemap.cli_keys import add_keys
from tidemap.cli_outbox import add_outbox
from tidemap.cli_server import add_questions
from tidemap.cli_support import (
    DONE,
    FAILED,
    WRONG_USAGE,
    UsageError,
    add_database,
    add_json,
    add_server,
    client_of,
    existing_settings,
    failed,
    port_option,
    settings_of,
)
from tidemap.errors import DatabaseUnusableError, DomainError, SchemaVersionError
from tidemap.requirements import unmet
from tidemap.version import __version__

if TYPE_CHECKING:
    from tidemap.settings import Settings

Command = Callable[[argparse.Namespace], int]


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; the exit status is 0 done, 1 failed, 2 wrong usage."""
    arguments = parser().parse_args(argv)
    command: Command = arguments.command
    if arguments.needs_server and (missing := unmet()) is not None:
        return failed(missing)
    try:
        return command(arguments)
    except UsageError as error:
        failed(str(error))
        return WRONG_USAGE
    except ValidationError as error:
        return failed(_explain(error))
    except (DomainError, OSError) as error:
        return failed(str(error))
    except KeyboardInterrupt:
        return FAILED


def _explain(error: ValidationError) -> str:
    locations = (
        f"TIDEMAP_{str(each['loc'][0]).upper()}: {each['msg'].removeprefix('Value error, ')}" for each in error.errors()
    )
    return "a setting is wrong. " + "; ".join(locations)


def parser() -> argparse.ArgumentParser:
    """All commands with their options."""
    whole = argparse.ArgumentParser(prog="tidemap", description="A map service for robots.")
    whole.add_argument("--version", action="version", version=f"tidemap {__version__}")
    whole.set_defaults(needs_server=True)
    commands = whole.add_subparsers(required=True, metavar="COMMAND")
    _add_serve(commands)
    worker = commands.add_parser("worker", help="do the background work alone, beside servers on the same database")
    add_database(worker)
    worker.set_defaults(command=_worker)
    _add_demo(commands)
    add_files(commands)
    migrate = commands.add_parser("migrate", help="bring the database to this version's schema")
    migrate.add_argument(
        "--partition",
        action="store_true",
        help="also put the tables that grow into partitions by location, on PostgreSQL; servers wait meanwhile",
    )
    add_database(migrate)
    add_json(migrate)
    migrate.set_defaults(command=_migrate)
    _add_backup(commands)
    _add_verify(commands)
    add_keys(commands)
    add_questions(commands)
    add_outbox(commands)
    add_completion(commands, parser)
    return whole


def _add_serve(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    serve = commands.add_parser("serve", help="run everything: API, pages, viewer, updater")
    add_database(serve)
    serve.add_argument("--host", help="address to listen on (default 127.0.0.1)")
    serve.add_argument("--port", type=port_option, help="port to listen on (default 8000; 0: any free one)")
    serve.add_argument("--open", action="store_true", default=None, help="listen beyond loopback without keys")
    serve.add_argument("--demo", action="store_true", help="fill in the demo building and keep its robot running")
    serve.set_defaults(command=_serve)


def _add_demo(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    demo = commands.add_parser("demo", help="seed the simulated building through the API and keep its robot running")
    add_server(demo, "an admin")
    demo.add_argument(
        "--sensors",
        action="store_true",
        help="instead a laboratory, seen by a depth camera and a laser: a week of scans, which takes some ten minutes",
    )
    demo.add_argument("--no-live", action="store_true", help="end when the history is posted")
    demo.set_defaults(command=_demo)


def _add_backup(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    backup = commands.add_parser(
        "backup",
        help="copy the embedded database to a file, also while a server is running",
        description="Copies the embedded database as it is at this moment, also while a server is running on it. "
        "For PostgreSQL it prints the pg_dump command to use.",
    )
    backup.add_argument("file", type=Path, metavar="FILE", help="where the copy goes")
    backup.add_argument("--overwrite", action="store_true", help="replace FILE if it is there")
    add_database(backup)
    add_json(backup)
    backup.set_defaults(command=_backup)


def _add_verify(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    verify = commands.add_parser(
        "verify",
        help="check everything stored: every blob, and the history against the log",
        description="Checks everything stored, also beside a running server, and changes nothing. "
        "Exit status: 0 nothing wrong, 1 something wrong, 2 the database cannot be opened.",
    )
    add_database(verify)
    verify.add_argument("--json", action="store_true", help="print one JSON object instead of a line a finding")
    verify.set_defaults(command=_verify)


def _migrate(arguments: argparse.Namespace) -> int:
    from tidemap.storage.store import migrate_database, partition_database

    settings = settings_of(arguments)
    migrate_database(settings.url)
    say = _quiet if arguments.json else _say_partitioned
    done = partition_database(settings.url, say) if arguments.partition else []
    report = {"migrated": True, "partitioned": done}
    print(json.dumps(report) if arguments.json else "The database is up to date.")
    return DONE


def _say_partitioned(table: str) -> None:
    print(f"Putting {table} into partitions.", flush=True)


def _quiet(_table: str) -> None:
    """Who asks for JSON reads one object."""


def _backup(arguments: argparse.Namespace) -> int:
    from tidemap.progress import ShownProgress
    from tidemap.storage.backup import back_up, dump_command

    settings, file = existing_settings(arguments), arguments.file
    if (dump := dump_command(settings.url, file)) is not None:
        raise UsageError(f"PostgreSQL is backed up with its own program (set PGPASSWORD if it asks for one):\n{dump}")
    if file.exists() and not arguments.overwrite:
        return failed(f"{file} is there already; choose another name, or say --overwrite.")
    with ShownProgress(sys.stderr).share("Copying pages") as show:
        back_up(settings.url, file, show)
    size = file.stat().st_size
    print(json.dumps({"file": str(file), "bytes": size}) if arguments.json else f"{file}: {size:,} bytes")
    return DONE


def _verify(arguments: argparse.Namespace) -> int:
    from tqdm import tqdm

    from tidemap.progress import ShownProgress
    from tidemap.services.verify import Finding, verify

    findings: list[Finding] = []

    def report(finding: Finding) -> None:
        findings.append(finding)
        if not arguments.json:
            tqdm.write(str(finding))

    try:
        with ShownProgress(sys.stderr).share("Verifying locations") as show:
            tally = verify(existing_settings(arguments).url, report, show)
    except (DatabaseUnusableError, SchemaVersionError) as error:
        failed(str(error))
        return WRONG_USAGE
    if arguments.json:
        print(json.dumps({**asdict(tally), "findings": [asdict(finding) for finding in findings]}))
    else:
        looked_at = f"{tally.locations:,} locations, {tally.blobs:,} blobs, {tally.observations:,} observations"
        print(f"{looked_at}: {f'{len(findings):,} wrong' if findings else 'nothing wrong'}")
    return FAILED if findings else DONE


def _serve(arguments: argparse.Namespace) -> int:
    from tidemap.server.binding import bind

    settings = settings_of(arguments)
    # First, for a port in use is said at once: what follows imports for seconds, and may compile for half a minute.
    with closing(bind(settings.host, settings.port)) as bound:
        return _serve_at(bound, settings, arguments.demo)


def _serve_at(bound: socket, settings: "Settings", demo: bool) -> int:
    from tidemap.server.memory import tune_malloc
    from tidemap.server.serving import ServeOptions, serve
    from tidemap.services.context import open_context
    from tidemap.services.keys import list_keys
    from tidemap.storage.store import prepare_database
    from tidemap_web.site import pages

    # Before there are threads: each would have a heap of its own.
    tune_malloc()
    prepare_database(settings.url)
    with open_context(settings) as ctx:
        if not settings.keyless and not list_keys(ctx):
            return failed(
                f"no key exists, so this server listens on loopback only, not on {settings.host}. Make one with "
                "'tidemap keys create --role admin', or say --open if a gateway before it checks who asks."
            )
        return serve(ctx, bound, ServeOptions(demo), pages)


def _worker(arguments: argparse.Namespace) -> int:
    from tidemap.server.memory import periodic_trim, tune_malloc
    from tidemap.server.processes import stop_on_signals, work
    from tidemap.server.warming import warm_up
    from tidemap.services.context import open_context
    from tidemap.storage.store import prepare_database

    settings = existing_settings(arguments)
    tune_malloc()
    prepare_database(settings.url)
    with open_context(settings) as ctx, periodic_trim():
        stop = stop_on_signals()
        if settings.dask_scheduler is None:
            work(ctx, stop)
        else:
            from tidemap.workers.dask_worker import serve_cluster

            warm_up()
            serve_cluster(ctx, settings.dask_scheduler, stop)
    return DONE


def _demo(arguments: argparse.Namespace) -> int:
    from threading import Event

    from tidemap.client import TidemapError as ServerError
    from tidemap.demo import lab_seed, live, seed

    log.configure("info")
    try:
        with client_of(arguments) as client:
            if arguments.sensors:
                lab_seed.seed(client)
            else:
                seed.seed(client)
            if not arguments.no_live:
                live.run(client, Event(), begin=lab_seed.LabPatrol if arguments.sensors else live.Rounds)
    except ServerError as error:
        return failed(str(error))
    return DONE


if __name__ == "__main__":
    sys.exit(main())
