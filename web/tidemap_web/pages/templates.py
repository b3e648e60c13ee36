"""Jinja2 pages: every answer carries our strict headers."""

from functools import cache
from pathlib import Path
from typing import Any

import jinja2
from fastapi import Request
from fastapi.responses import HTMLResponse

import tidemap
from tidemap_web.pages import spark, words
from tidemap_web.pages.assets import asset

FOLDER = Path(__file__).parent
CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'self'"
)


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(FOLDER / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals.update(asset=asset, spark=spark.path, words=words, version=tidemap.__version__)
    return environment


def page(request: Request, name: str, facts: dict[str, Any], csp: str = CSP, status: int = 200) -> HTMLResponse:
    """A page of the template `name`; it is never stored by caches, for it may be behind a key."""
    html = _environment().get_template(name).render(**facts, path=request.url.path)
    headers = {
        "Content-Security-Policy": csp,
        "Referrer-Policy": "same-origin",
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "no-store",
    }
    return HTMLResponse(html, status, headers)
