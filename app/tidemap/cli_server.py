"""Commands that ask a running server through the client: `tidemap locations`, `anomalies` and `update`."""

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeAlias

from tidemap.cli_support import (
    DONE,
    FAILED,
    UsageError,
    add_json,
    add_server,
    client_of,
    count_option,
    failed,
    positive_option,
    time_option,
)

if TYPE_CHECKING:
    from pydantic import BaseModel

    from tidemap.client import Client
    from tidemap.schemas.anomalies import Event

Action: TypeAlias = "Callable[[Client[Any], argparse.Namespace], int]"
MAX_SHOWN = 100


def add_questions(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the commands to a parser."""
    _add_locations(commands)
    anomalies = commands.add_parser("anomalies", help="list stored anomalies, oldest first")
    anomalies.add_argument("--location", metavar="NAME", help="of this location alone")
    anomalies.add_argument(
        "--start", type=time_option, metavar="TIME", help="since: ISO 8601 with a zone, or Unix seconds"
    )
    anomalies.add_argument("--stop", type=time_option, metavar="TIME", help="before")
    anomalies.add_argument("--after", type=int, metavar="ID", help="those stored after this one")
    anomalies.add_argument("--open", action="store_true", help="only what nobody has acknowledged")
    anomalies.add_argument(
        "--limit", type=count_option, default=MAX_SHOWN, help="at most so many (default %(default)s)"
    )
    _finish(anomalies, _anomalies, "an operator")
    update = commands.add_parser("update", help="refit a location and wait for it")
    update.add_argument("name", metavar="NAME")
    update.add_argument(
        "--wait", type=positive_option, metavar="SECONDS", help="wait at most so long (default: to the end)"
    )
    _finish(update, _update, "an operator")


def _add_locations(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    locations = commands.add_parser("locations", help="list, show, rename and delete locations")
    actions = locations.add_subparsers(required=True, metavar="ACTION")
    _finish(actions.add_parser("list", help="list all locations"), _list, "an operator")
    show = actions.add_parser("show", help="show one location")
    show.add_argument("name", metavar="NAME")
    _finish(show, _show, "an operator")
    rename = actions.add_parser("rename", help="give a location another name")
    rename.add_argument("name", metavar="NAME")
    rename.add_argument("new_name", metavar="NEW_NAME")
    _finish(rename, _rename, "an admin")
    delete = actions.add_parser("delete", help="delete a location with all that was observed there")
    delete.add_argument("name", metavar="NAME")
    delete.add_argument("--yes", action="store_true", required=True, help="needed: it cannot be undone")
    _finish(delete, _delete, "an admin")


def _finish(command: argparse.ArgumentParser, action: Action, who: str) -> None:
    add_server(command, who)
    add_json(command)
    command.set_defaults(command=_command(action), needs_server=False)


def _command(action: Action) -> Callable[[argparse.Namespace], int]:
    def run(arguments: argparse.Namespace) -> int:
        from tidemap.client import TidemapError

        try:
            with client_of(arguments) as client:
                return action(client, arguments)
        except ValueError as error:
            raise UsageError(str(error)) from None
        except TidemapError as error:
            return failed(str(error))

    return run


def _print(answer: "BaseModel", text: str, as_json: bool) -> int:
    """Print an answer as JSON, or what a person wants to read of it."""
    print(json.dumps(answer.model_dump(mode="json")) if as_json else text)
    return DONE


def _print_all(answers: "Sequence[BaseModel]", lines: Iterable[str], as_json: bool) -> int:
    """Print a list as JSON, or a line for each."""
    if as_json:
        print(json.dumps([each.model_dump(mode="json") for each in answers]))
    else:
        print("".join(f"{line}\n" for line in lines), end="")
    return DONE


def _list(client: "Client[Any]", arguments: argparse.Namespace) -> int:
    found = client.locations()
    lines = [
        f"{each.name}\t{each.kind}\trevision {each.revision}\t{each.observations} measurements\t"
        f"{each.open_anomalies} open anomalies"
        for each in found
    ]
    return _print_all(found, lines, arguments.json)


def _show(client: "Client[Any]", arguments: argparse.Namespace) -> int:
    found = client.location(arguments.name).get()
    facts = found.model_dump(mode="json", exclude_none=True)
    lines = [f"{name}\t{value if isinstance(value, str) else json.dumps(value)}" for name, value in facts.items()]
    return _print(found, "\n".join(lines), arguments.json)


def _rename(client: "Client[Any]", arguments: argparse.Namespace) -> int:
    found = client.location(arguments.name).patch(name=arguments.new_name)
    return _print(found, f"{arguments.name} is {found.name} now.", arguments.json)


def _delete(client: "Client[Any]", arguments: argparse.Namespace) -> int:
    client.location(arguments.name).delete()
    print(json.dumps({"deleted": arguments.name}) if arguments.json else f"{arguments.name} is deleted.")
    return DONE


def _anomalies(client: "Client[Any]", arguments: argparse.Namespace) -> int:
    asked = client if arguments.location is None else client.location(arguments.location)
    events = asked.anomalies(
        after=arguments.after,
        start=arguments.start,
        stop=arguments.stop,
        acknowledged=False if arguments.open else None,
        limit=min(arguments.limit, 1000),
    )
    found = list(islice(events, arguments.limit))
    return _print_all(found, (_line(event) for event in found), arguments.json)


def _line(event: "Event") -> str:
    shown = event.model_dump(mode="json")
    seen = f"{'occupied' if event.observed else 'free'}, expected {event.probability:.2f}"
    columns = (event.id, event.location, shown["start"], shown["stop"], seen, f"{event.cells_total} cells")
    return "\t".join(map(str, (*columns, event.acknowledged_by or "open")))


def _update(client: "Client[Any]", arguments: argparse.Namespace) -> int:
    job = client.location(arguments.name).update(wait=True if arguments.wait is None else arguments.wait)
    _print(job, f"Job {job.id}: {job.state}{f' ({job.error})' if job.error else ''}", arguments.json)
    if job.state in ("failed", "cancelled"):
        return FAILED
    if job.state != "done":
        print(f"tidemap: it goes on; ask for it with GET /api/v1/jobs/{job.id}", file=sys.stderr)
    return DONE
