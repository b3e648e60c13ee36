"""A real HTTP server in a thread that keeps what it is sent and answers by a script, or hangs up."""

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass
class Received:
    """One request as it arrived."""

    method: str
    path: str
    headers: dict[str, str]
    content: bytes


@dataclass
class Said:
    """One answer, `after_s` seconds late. `hang_up` drops the connection after the request was read, before it."""

    status: int = 200
    body: Any = None
    headers: dict[str, str] = field(default_factory=dict)
    hang_up: bool = False
    after_s: float = 0.0


class Script:
    """Answers in turn; the last one is repeated."""

    def __init__(self, *answers: Said) -> None:
        self.answers = list(answers)
        self.received: list[Received] = []
        self.url = ""

    def next(self) -> Said:
        """The next answer."""
        return self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]


@contextmanager
def scripted(*answers: Said) -> Iterator[Script]:
    """A server on a free port that answers with `answers` in turn."""
    script = Script(*answers)

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def answer(self) -> None:
            content = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            script.received.append(Received(self.command, self.path, dict(self.headers), content))
            said = script.next()
            if said.after_s:
                time.sleep(said.after_s)
            self.close_connection = said.hang_up
            if not said.hang_up:
                self.say(said)

        def say(self, said: Said) -> None:
            body = said.body if isinstance(said.body, bytes) else json.dumps(said.body).encode()
            self.send_response(said.status)
            for name, value in (said.headers | {"Content-Length": str(len(body))}).items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        do_GET = do_POST = do_PATCH = do_DELETE = answer  # noqa: N815

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    script.url = f"http://127.0.0.1:{server.server_port}"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield script
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
