"""Static files at addresses that change with their content, so that browsers keep them for good."""

import gzip
import mimetypes
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path

from fastapi import APIRouter, Request, Response
from starlette.exceptions import HTTPException

STATIC = Path(__file__).parent / "static"
FOREVER = "public, max-age=31536000, immutable"
MIN_PACKED_BYTES = 512
"""Smaller files gain nothing by compression."""
_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}


@dataclass(frozen=True, slots=True)
class Asset:
    """A file as it is sent; `packed` is None where compression does not make it smaller."""

    body: bytes
    packed: bytes | None
    media_type: str


@cache
def _files() -> dict[str, Path]:
    return {path.relative_to(STATIC).as_posix(): path for path in sorted(STATIC.rglob("*")) if path.is_file()}


@cache
def version() -> str:
    """One hash of all files: a script imports others by relative addresses, which are below it then."""
    total = sha256()
    for name, path in _files().items():
        total.update(f"{name}\0{path.stat().st_size}\0".encode())
        total.update(path.read_bytes())
    return total.hexdigest()[:12]


def asset(name: str) -> str:
    """The address of a static file. Raises KeyError where there is none."""
    if name not in _files():
        raise KeyError(name)
    return f"/static/{version()}/{name}"


@cache
def _asset(name: str) -> Asset:
    path = _files()[name]
    body = path.read_bytes()
    packed = gzip.compress(body, 9, mtime=0)
    guessed = _TYPES.get(path.suffix) or mimetypes.guess_type(name)[0] or "application/octet-stream"
    return Asset(body, packed if len(packed) < len(body) and len(body) >= MIN_PACKED_BYTES else None, guessed)


def router() -> APIRouter:
    """All static files. The address of another version answers with this one's, which is not to be kept."""
    routes = APIRouter(include_in_schema=False)

    @routes.api_route("/static/{asked}/{name:path}", methods=["GET", "HEAD"], response_model=None)
    def static(request: Request, asked: str, name: str) -> Response:
        """One file."""
        if name not in _files():
            raise HTTPException(404)
        found = _asset(name)
        headers = {
            "Cache-Control": FOREVER if asked == version() else "no-cache",
            "X-Content-Type-Options": "nosniff",
            "Vary": "Accept-Encoding",
        }
        if found.packed is not None and "gzip" in request.headers.get("accept-encoding", ""):
            return Response(found.packed, headers={"Content-Encoding": "gzip", **headers}, media_type=found.media_type)
        return Response(found.body, headers=headers, media_type=found.media_type)

    return routes
