"""The command `tidemap keys`: make, list, rotate and revoke API keys, straight in the database."""

import argparse
import getpass
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tidemap.cli_support import (
    DONE,
    UsageError,
    add_database,
    add_json,
    duration_option,
    existing_settings,
    time_option,
)

if TYPE_CHECKING:
    from tidemap.services.context import Context
    from tidemap.services.keys import IssuedKey

DAY_S = 86400.0


def add_keys(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to a parser."""
    keys = commands.add_parser("keys", help="make, list, rotate and revoke API keys")
    actions = keys.add_subparsers(required=True, metavar="ACTION")
    create = actions.add_parser("create", help="make a key; its secret is shown this once")
    create.add_argument("--role", required=True, choices=("robot", "operator", "admin"))
    create.add_argument("--name", help="whose key it is (default: the role)")
    create.add_argument(
        "--location",
        action="append",
        metavar="NAME",
        help="limit it to a location, or to all whose names begin so where it ends in *; can be given often",
    )
    create.add_argument("--expires", metavar="TIME", type=time_option, help="when it ends: ISO 8601 with a zone")
    _finish(create, _create)
    _finish(actions.add_parser("list", help="list the keys"), _list)
    rotate = actions.add_parser("rotate", help="make another key like one, which itself expires after an overlap")
    rotate.add_argument("id", type=int)
    rotate.add_argument(
        "--overlap",
        type=duration_option,
        default=DAY_S,
        metavar="SECONDS",
        help="how long the old one still opens (default: a day)",
    )
    _finish(rotate, _rotate)
    revoke = actions.add_parser("revoke", help="revoke a key")
    revoke.add_argument("id", type=int)
    _finish(revoke, _revoke)


def _finish(command: argparse.ArgumentParser, run: Callable[[argparse.Namespace], int]) -> None:
    add_database(command)
    add_json(command)
    command.set_defaults(command=run)


@contextmanager
def _opened(arguments: argparse.Namespace, action: str, target: str, detail: str | None = None) -> Iterator["Context"]:
    """The database, whose changes are noted as made by the user of this command: which key, and what was given."""
    from tidemap.services.audit import audited
    from tidemap.services.context import open_context
    from tidemap.services.keys import Principal

    who = Principal(f"{_user()} on the command line", "admin", None)
    with open_context(existing_settings(arguments)) as ctx:
        yield audited(ctx, who, f"tidemap keys {action}", target, detail)


def _user() -> str:
    """The name of who runs this; in a container a user may have none."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return f"uid {os.getuid()}"


def _create(arguments: argparse.Namespace) -> int:
    from pydantic import ValidationError

    from tidemap.schemas.keys import KeyForm
    from tidemap.scope import Scope
    from tidemap.services.keys import create_key

    try:
        form = KeyForm(
            name=arguments.name or arguments.role,
            role=arguments.role,
            locations=arguments.location,
            expires_at=arguments.expires,
        )
    except ValidationError as error:
        raise UsageError(f"--location or --name: {error.errors()[0]['msg']}") from None
    with _opened(arguments, "create", form.name, form.model_dump_json(exclude_defaults=True)) as ctx:
        key = create_key(ctx, form.name, form.role, Scope.of(form.locations), form.expires_at)
    return _show(key, arguments.json)


def _rotate(arguments: argparse.Namespace) -> int:
    from tidemap.services.keys import rotate_key

    with _opened(arguments, "rotate", str(arguments.id), json.dumps({"overlap_s": arguments.overlap})) as ctx:
        key = rotate_key(ctx, arguments.id, arguments.overlap)
    return _show(key, arguments.json)


def _show(key: "IssuedKey", as_json: bool) -> int:
    from tidemap.api.views.keys import new_key_view

    view = new_key_view(key).model_dump(mode="json")
    if as_json:
        print(json.dumps(view))
    else:
        end = f", until {view['expires_at']}" if view["expires_at"] else ""
        print(key.key)
        print(f"Key {key.id} ({key.name}, {key.role}{end}). This secret is shown this once.", file=sys.stderr)
    return DONE


def _list(arguments: argparse.Namespace) -> int:
    from tidemap.api.views.keys import key_view
    from tidemap.services.context import open_context
    from tidemap.services.keys import list_keys

    with open_context(existing_settings(arguments)) as ctx:
        keys = [key_view(key).model_dump(mode="json") for key in list_keys(ctx)]
    if arguments.json:
        print(json.dumps(keys))
        return DONE
    for key in keys:
        limits = [*(key["locations"] or ()), *([f"until {key['expires_at']}"] if key["expires_at"] else [])]
        used = f"used {key['last_used_at']}" if key["last_used_at"] else "never used"
        print(
            "\t".join([str(key["id"]), key["role"], f"{key['prefix']}…", key["name"], used, " ".join(limits)]).rstrip()
        )
    return DONE


def _revoke(arguments: argparse.Namespace) -> int:
    from tidemap.services.keys import delete_key

    with _opened(arguments, "revoke", str(arguments.id)) as ctx:
        delete_key(ctx, arguments.id)
    print(json.dumps({"revoked": arguments.id}) if arguments.json else f"Key {arguments.id} is revoked.")
    return DONE
