"""Commands run in this process: the same code as `run_command` without the seconds a process takes to start."""

import io
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from unittest.mock import patch

from tests.support.server import clean_environment
from tidemap.cli import main


@dataclass(frozen=True)
class Done:
    """How a command ended."""

    returncode: int
    stdout: str
    stderr: str


def command(*words: str, env: dict[str, str] | None = None) -> Done:
    """Run `tidemap …` to its end; it may fail, but never with a trace."""
    said, complained = io.StringIO(), io.StringIO()
    environment = clean_environment() | (env or {})
    with redirect_stdout(said), redirect_stderr(complained), patch.dict("os.environ", environment, clear=True):
        try:
            status = main(words)
        except SystemExit as ended:
            status = int(ended.code or 0)
    assert "Traceback" not in complained.getvalue()
    return Done(status, said.getvalue(), complained.getvalue())
