"""Requests as the API wants them."""

import json
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote, unquote

from tidemap.client.plans import Request, Scalar
from tidemap.client.times import unix
from tidemap.media_types import JSON


def present(**parameters: Any) -> dict[str, Any]:
    """The parameters that are not None, those named start, stop, epoch and as_of in Unix seconds."""
    chosen = {name: value for name, value in parameters.items() if value is not None}
    return {
        name: unix(value) if name in {"start", "stop", "epoch", "as_of"} else value for name, value in chosen.items()
    }


def post(
    path: str, form: Mapping[str, Any], query: Mapping[str, Scalar] | None = None, repeatable: bool = True
) -> Request:
    """A POST of a JSON form."""
    return send("POST", path, form, query or {}, repeatable)


def send(method: str, path: str, form: Mapping[str, Any], query: Mapping[str, Scalar], repeatable: bool) -> Request:
    """A request with a JSON form."""
    content = json.dumps(form, allow_nan=False).encode()
    return Request(method, path, query, content, {"Content-Type": JSON}, repeatable)


def path_of(name: str) -> str:
    """The path of the location `name`."""
    return f"/locations/{quote(name, safe='')}"


def name_of(path: str) -> str:
    """The name of the location at `path`.

    >>> name_of(path_of("a door"))
    'a door'
    """
    return unquote(path.removeprefix("/locations/"))
