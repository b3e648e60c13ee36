"""A proxy that breaks its connections, as mobile networks and impatient proxies do."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial

CHUNK = 1 << 12


class CuttingProxy:
    """Passes bytes on to a port of this machine. Of every connection it passes so many bytes of the answer as
    `allowed` says for it (None: all of them), and then ends it; or it ends it after `lasts_s`."""

    def __init__(self, port: int, allowed: Callable[[], int | None], lasts_s: float | None = None) -> None:
        self._port = port
        self._allowed = allowed
        self._lasts_s = lasts_s
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._open: set[socket.socket] = set()
        self.connections = 0
        self.url = f"http://127.0.0.1:{self._listener.getsockname()[1]}"

    def run(self) -> None:
        """Until the listener is closed."""
        with suppress(OSError):
            while True:
                here, _ = self._listener.accept()
                self.connections += 1
                there = socket.create_connection(("127.0.0.1", self._port))
                self._open |= {here, there}
                self._start(here, there)

    def close(self) -> None:
        """End everything."""
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for each in list(self._open):
            _end(each)

    def _start(self, here: socket.socket, there: socket.socket) -> None:
        for carry in (partial(self._carry, here, there, None), partial(self._carry, there, here, self._allowed())):
            threading.Thread(target=carry, daemon=True).start()
        if self._lasts_s is not None:
            timer = threading.Timer(self._lasts_s, self._cut, (here, there))
            timer.daemon = True
            timer.start()

    def _carry(self, source: socket.socket, target: socket.socket, left: int | None) -> None:
        with suppress(OSError):
            while (left is None or left > 0) and (data := source.recv(CHUNK)):
                part = data if left is None else data[:left]
                target.sendall(part)
                left = None if left is None else left - len(part)
        self._cut(source, target)

    def _cut(self, *both: socket.socket) -> None:
        for each in both:
            self._open.discard(each)
            _end(each)


def _end(each: socket.socket) -> None:
    with suppress(OSError):
        each.shutdown(socket.SHUT_RDWR)
    each.close()


@contextmanager
def cutting(
    port: int, allowed: Callable[[], int | None] = lambda: None, lasts_s: float | None = None
) -> Iterator[CuttingProxy]:
    """A running proxy."""
    proxy = CuttingProxy(port, allowed, lasts_s)
    thread = threading.Thread(target=proxy.run)
    thread.start()
    try:
        yield proxy
    finally:
        proxy.close()
        thread.join()
