"""Whether a command line that documentation shows is one that the command would take."""

import argparse
from collections.abc import Sequence


def refusal(parser: argparse.ArgumentParser, words: Sequence[str]) -> str:
    """What `parser` does not know of a command line; empty when it knows every command and option.

    Values are not parsed, for they may be placeholders such as NAME.
    """
    for word in words:
        commands = _commands(parser)
        if word.startswith("-"):
            if word.split("=")[0] not in _options(parser):
                return f"no option {word}"
        elif commands and not _is_value(word):
            if word not in commands:
                return f"no command {word}"
            parser = commands[word]
    return ""


def _commands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    groups = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(groups[0].choices) if groups else {}


def _options(parser: argparse.ArgumentParser) -> set[str]:
    return {option for action in parser._actions for option in action.option_strings}


def _is_value(word: str) -> bool:
    return not word.replace("-", "").isalpha() or not word.islower()
