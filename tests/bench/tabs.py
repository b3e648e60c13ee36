"""Open viewers without browsers: `python -m tests.bench.tabs PORT LOCATION COUNT`, live, until its input ends.

Each has the two sockets of a tab. It says `open` once every one of them has drawn.
"""

import json
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from secrets import token_hex
from typing import Any

import msgspec
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from tests.bench.watching import CAMERA, answer

WAIT_S = 600.0
HOW: dict[str, Any] = {"proxy": None, "max_size": None, "compression": None}


def main(port: str, location: str, count: str) -> None:
    """Until nobody needs them."""
    drawn = [threading.Event() for _ in range(int(count))]
    pool = ThreadPoolExecutor(2 * len(drawn))
    for each in drawn:
        pool.submit(control, f"ws://127.0.0.1:{port}/view", location, token_hex(8), each, pool)
    assert all(each.wait(WAIT_S) for each in drawn)
    sys.stdout.write("open\n")
    sys.stdout.flush()
    sys.stdin.read()


def control(address: str, location: str, token: str, drawn: threading.Event, pool: ThreadPoolExecutor) -> None:
    """The page's socket; the scene's is opened beside it."""
    with connect(f"{address}/control/{token}", **HOW) as socket:
        socket.send(json.dumps({"kind": "view", "location": location, "live": True}))
        pool.submit(scene, f"{address}/scene/{token}")
        for text in socket:
            message = json.loads(text)
            if message["kind"] == "frame" and message["drawn"]:
                drawn.set()


def scene(address: str) -> None:
    """The socket of viser's client."""
    spoken = [Subprotocol(f"viser-v{viser.__version__}")]
    try:
        with connect(address, subprotocols=spoken, **HOW) as socket:
            socket.send(msgspec.msgpack.encode(CAMERA))
            for window in socket:
                answer(socket, bytes(window) if isinstance(window, bytes) else b"")
    except ConnectionClosed:
        return


if __name__ == "__main__":
    main(*sys.argv[1:4])
