"""A receiver of webhooks, which checks what comes as receivers do, with the reference of Standard Webhooks."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from standardwebhooks.webhooks import Webhook

BREAK = 0
"""Instead of a status: the connection ends without an answer."""


@dataclass
class Receiver:
    """What has come, whatever was answered: (webhook-id, message). `secret` is set once the webhook is made."""

    answer: Callable[[], int] = lambda: 204
    url: str = ""
    secret: str = ""
    came: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    accepted: list[tuple[str, dict[str, Any]]] = field(default_factory=list)

    def take(self, body: bytes, headers: dict[str, str]) -> int:
        """The status to answer with."""
        message = Webhook(self.secret).verify(body, headers)
        status = self.answer()
        entry = headers["webhook-id"], message
        self.came.append(entry)
        if 200 <= status < 300:
            self.accepted.append(entry)
        return status


@contextmanager
def receiving(answer: Callable[[], int] = lambda: 204, headers: dict[str, str] | None = None) -> Iterator[Receiver]:
    """A receiver on this machine."""
    receiver = Receiver(answer)

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            status = receiver.take(body, {name.lower(): value for name, value in self.headers.items()})
            if status != BREAK:
                self.send_response(status)
                for name, value in (headers or {}).items():
                    self.send_header(name, value)
                self.send_header("Content-Length", "0")
                self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    receiver.url = f"http://127.0.0.1:{server.server_port}/alarms"
    try:
        yield receiver
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
