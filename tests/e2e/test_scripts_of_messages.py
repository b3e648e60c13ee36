"""A script that viser's server sends to our own page runs nothing in it."""

import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from playwright.sync_api import Page

from tests.support.paths import ROOT
from tests.support.server import StartServer
from tests.support.viewer import make_grid
from tests.support.waiting import WAIT_S

SENDS_A_SCRIPT = """
import sys
from viser._messages import RunJavascriptMessage
from tidemap.cli import main
from tidemap_web.viewer.server import ViewerServer
welcome = ViewerServer._welcome
def welcome_with_a_script(self, client):
    welcome(self, client)
    client._websock_connection.queue_message(RunJavascriptMessage("document.documentElement.dataset.taken = '1'"))
ViewerServer._welcome = welcome_with_a_script
sys.exit(main(sys.argv[1:]))
"""


def launch(words: Sequence[str], env: Mapping[str, str], log: Path) -> "subprocess.Popen[bytes]":
    """A server whose viser sends a script to every tab."""
    with log.open("ab") as output:
        command = [sys.executable, "-c", SENDS_A_SCRIPT, *words]
        return subprocess.Popen(command, cwd=ROOT, env=env, stdin=subprocess.DEVNULL, stdout=output, stderr=output)


def test_a_script_from_our_own_viser_is_refused(server: StartServer, page: Page) -> None:
    running = server(launch=launch)
    make_grid(running.url, "lab", days=1)
    # The error says that the message came, and that the policy stopped it.
    with page.expect_event("pageerror", lambda error: "'unsafe-eval'" in error.message, timeout=WAIT_S * 1000):
        page.goto(f"{running.url}/view/?location=lab&fixedDpr=1")
    taken = [frame.evaluate("document.documentElement.dataset.taken || ''") for frame in page.frames]
    assert taken == ["", ""]
