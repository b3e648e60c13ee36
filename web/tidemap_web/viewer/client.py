"""Viser's own client as a page of ours: which scripts may run in it, whom it may reach, what its address may hold."""

import base64
import gzip
import re
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from urllib.parse import urlencode

import numpy as np
import viser
import zstandard
from starlette.datastructures import QueryParams

from tidemap_web.viewer import colors

PATH = "/view/scene/"
_ALPHABET = r"!#$%()*+,-./0123456789:;=?@ABCDEFGHIJKLMNOPQRSTUVWXYZ[\]^_abcdefghijklmnopqrstuvwxyz{|}~"
_PACKED = re.compile(r'data-p="([^"]*)" data-ss="(\d+)" data-cs="(\d+)"')
_INLINE = re.compile(r"<script[^>]*>(.*?)</script>", re.DOTALL)
_RATIO = re.compile(r"[1-4](\.\d{1,3})?")


@dataclass(frozen=True, slots=True)
class ClientPage:
    """The gzipped page, a version that changes with it, and its Content-Security-Policy."""

    body: bytes
    version: str
    csp: str


@cache
def client_page() -> ClientPage:
    """Viser's page with our few lines at its head. Raises RuntimeError where this viser packs it in another way."""
    html = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text("utf-8")
    head = (Path(__file__).parent / "scene_head.html").read_text("utf-8")
    html = html.replace("<head>", "<head>" + head.replace("BACKGROUND", colors.css(colors.BACKGROUND)), 1)
    csp = _policy([script.encode() for script in _INLINE.findall(html)] + [_packed_script(html)])
    version = sha256(html.encode() + csp.encode()).hexdigest()[:8]
    return ClientPage(gzip.compress(html.encode()), f"{viser.__version__}-{version}", csp)


def scene_address(asked: QueryParams | None = None) -> str:
    """The only address the scene is served at: viser's client reads `websocket`, `playbackPath` and more from it.

    >>> scene_address(QueryParams("websocket=ws://evil.example&fixedDpr=2")).split("&")[1:]
    ['fixedDpr=2']
    """
    query = {"v": client_page().version}
    ratio = "" if asked is None else asked.get("fixedDpr", "")
    if _RATIO.fullmatch(ratio):
        query["fixedDpr"] = ratio
    return f"{PATH}?{urlencode(query)}"


def _policy(scripts: list[bytes]) -> str:
    """Only these scripts run, none from a message (no 'unsafe-eval'); only our own host is reached."""
    hashes = " ".join(f"'sha256-{base64.b64encode(sha256(script).digest()).decode()}'" for script in scripts)
    return (
        f"default-src 'none'; script-src {hashes} 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
        "img-src data: blob:; font-src data:; worker-src blob:; connect-src 'self' data: blob:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
    )


def _packed_script(html: str) -> bytes:
    """The script that viser's page unpacks and runs: base 88, then zstandard, after the styles."""
    found = _PACKED.search(html)
    if found is None:
        raise RuntimeError(f"viser {viser.__version__} packs its client in a way that is not known here")
    packed, styles, script = found[1], int(found[2]), int(found[3])
    plain = zstandard.ZstdDecompressor().decompress(_base88(packed), max_output_size=styles + script)
    return plain[styles:]


def _base88(text: str) -> bytes:
    """Five characters for four bytes, big-endian; of a rest, one character more than bytes."""
    digit = np.zeros(128, np.uint64)
    digit[list(_ALPHABET.encode())] = np.arange(len(_ALPHABET))
    digits = digit[np.frombuffer(text.encode("ascii"), np.uint8)]
    whole = len(digits) // 5 * 5
    weights = np.array([88**4, 88**3, 88**2, 88, 1], np.uint64)
    data = (digits[:whole].reshape(-1, 5) @ weights).astype(">u4").tobytes()
    rest = 0
    for value in digits[whole:].tolist():
        rest = rest * 88 + value
    return data + rest.to_bytes(max(0, len(digits) - whole - 1), "big")
