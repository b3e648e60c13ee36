"""The command `tidemap completion`: what a shell reads to complete our commands and options."""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from tidemap.cli_support import DONE

if TYPE_CHECKING:
    from argparse import ArgumentParser

SHELLS = ("bash", "zsh", "fish")
HOW = """Add to ~/.bashrc:  source <(tidemap completion bash)
For zsh:           tidemap completion zsh > a folder of $fpath, as _tidemap
For fish:          tidemap completion fish > ~/.config/fish/completions/tidemap.fish"""


def add_completion(
    commands: "argparse._SubParsersAction[ArgumentParser]", whole: "Callable[[], ArgumentParser]"
) -> None:
    """Add the command to a parser; `whole` makes the parser with all commands."""
    completion = commands.add_parser(
        "completion",
        help="print a script that completes these commands in a shell",
        description=HOW,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    completion.add_argument("shell", choices=SHELLS)

    def show(arguments: argparse.Namespace) -> int:
        import shtab

        parser = whole()
        for action in _actions(parser):
            if action.type is Path:
                folder = "--data" in action.option_strings
                action.complete = shtab.DIRECTORY if folder else shtab.FILE  # type: ignore[attr-defined]
        print(shtab.complete(parser, arguments.shell))
        return DONE

    completion.set_defaults(command=show)


def _actions(parser: "ArgumentParser") -> Iterator[argparse.Action]:
    """Of all commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)
