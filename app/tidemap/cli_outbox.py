"""The command `tidemap outbox`: what the server has refused, and what becomes of it. It needs no server package."""

import argparse
import json
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from tidemap.cli_support import DONE, add_json, failed

if TYPE_CHECKING:
    from tidemap.client.outbox.store import OutboxStore, Refused

Action: TypeAlias = "Callable[[OutboxStore, argparse.Namespace], list[int] | None]"
"""Returns the numbers of the batches that it dealt with; None where it has said all itself."""


def add_outbox(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to a parser."""
    outbox = commands.add_parser("outbox", help="list what a server refused of a robot's outbox, and deal with it")
    actions = outbox.add_subparsers(required=True, metavar="ACTION")
    _add(actions, "list", _list, "list the refused batches with their reasons")
    retry = _add(actions, "retry", _retry, "send refused batches again: all of them, or those named")
    retry.add_argument("id", type=int, nargs="*")
    move = _add(actions, "move", _move, "send refused batches to another location, such as a renamed one")
    move.add_argument("location", help="the name of the location that they go to")
    move.add_argument("id", type=int, nargs="+")
    drop = _add(actions, "drop", _drop, "throw refused batches away")
    drop.add_argument("id", type=int, nargs="+")


def _add(
    actions: "argparse._SubParsersAction[argparse.ArgumentParser]", name: str, action: Action, says: str
) -> argparse.ArgumentParser:
    command = actions.add_parser(name, help=says)
    command.add_argument("file", type=Path, metavar="FILE", help="the outbox, as given to the client")
    add_json(command)
    command.set_defaults(command=_command(action), needs_server=False)
    return command


def _command(action: Action) -> Callable[[argparse.Namespace], int]:
    def run(arguments: argparse.Namespace) -> int:
        from tidemap.client.errors import OutboxError

        try:
            with _opened(arguments.file) as store:
                done = action(store, arguments)
        except OutboxError as error:
            return failed(str(error))
        if arguments.json and done is not None:
            print(json.dumps({"batches": done}))
        return DONE

    return run


@contextmanager
def _opened(file: Path) -> Iterator["OutboxStore"]:
    """The outbox in a file that is there. Raises OutboxError."""
    from tidemap.client.errors import OutboxError
    from tidemap.client.outbox.file import prepare
    from tidemap.client.outbox.store import OutboxStore

    if not file.is_file():
        raise OutboxError(f"{file}: there is no such file; name the outbox as the client does")
    prepare(file.absolute())
    with closing(OutboxStore(file.absolute(), durable=True)) as store:
        yield store


def _list(store: "OutboxStore", arguments: argparse.Namespace) -> None:
    refused, pending = store.refused(), store.pending()
    if arguments.json:
        print(json.dumps({"pending": asdict(pending), "refused": [asdict(each) for each in refused]}))
        return
    for each in refused:
        print(_line(each))
    print(f"{len(refused)} refused, {pending.batches} waiting")


def _line(refused: "Refused") -> str:
    from tidemap.client.requests import name_of

    return f"{refused.id}\t{name_of(refused.path)}\t{refused.measurements} measurements\t{refused.error}"


def _retry(store: "OutboxStore", arguments: argparse.Namespace) -> list[int]:
    numbers = arguments.id or [each.id for each in store.refused()]
    for number in numbers:
        store.retry(number)
    return numbers


def _move(store: "OutboxStore", arguments: argparse.Namespace) -> list[int]:
    from tidemap.client.requests import path_of

    for number in arguments.id:
        store.move(number, path_of(arguments.location))
    return list(arguments.id)


def _drop(store: "OutboxStore", arguments: argparse.Namespace) -> list[int]:
    for number in arguments.id:
        store.discard(number)
    return list(arguments.id)
