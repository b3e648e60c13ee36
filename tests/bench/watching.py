"""A browser's place at viser's socket: `python -m tests.bench.watching PORT TOKEN HEADER SECRET`.

It takes all that is sent, looks at none of it, and answers what asks whether it has come.
"""

import sys
from typing import Any

import msgspec
import viser
import zstandard
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, -5.0, 5.0],
    "fov": 0.7,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


def main(port: str, token: str, header: str, secret: str) -> None:
    """Until the server closes."""
    address = f"ws://127.0.0.1:{port}/?token={token}"
    spoken = [Subprotocol(f"viser-v{viser.__version__}")]
    how: dict[str, Any] = {"subprotocols": spoken, "max_size": None, "compression": None}
    with connect(address, proxy=None, additional_headers={header: secret}, **how) as socket:
        socket.send(msgspec.msgpack.encode(CAMERA))
        for window in socket:
            answer(socket, bytes(window) if isinstance(window, bytes) else b"")


def answer(socket: Connection, window: bytes) -> None:
    """To each question for an item of the browser's storage."""
    size = int.from_bytes(window[8:16], "little")
    content = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(window[16 : 16 + size]))
    for message in content["messages"]:
        if message["type"] == "LocalStorageGetItemRequestMessage":
            kept = {"value": None, "error": None, "request_uuid": message["request_uuid"]}
            socket.send(msgspec.msgpack.encode({"type": "LocalStorageGetItemResponseMessage", **kept}))


if __name__ == "__main__":
    main(*sys.argv[1:5])
