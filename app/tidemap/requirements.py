"""What the server needs and a robot with the client alone need not have."""

import sys
from importlib.metadata import version
from importlib.util import find_spec

MIN_PYTHON = (3, 11)
MIN_NUMPY = 2
MODULES = (
    "PIL",
    "alembic",
    "fastapi",
    "jinja2",
    "numba",
    "orjson",
    "prometheus_client",
    "psycopg",
    "pyarrow",
    "pydantic_settings",
    "python_multipart",
    "scipy",
    "small_gicp",
    "sqlalchemy",
    "tqdm",
    "uvicorn",
    "viser",
    "xxhash",
    "yaml",
    "zstandard",
)
"""By the names they are imported with, what the extra `server` installs."""


def unmet() -> str | None:
    """Why this Python cannot run the server, and what to do about it; None where it can."""
    if sys.version_info < MIN_PYTHON:
        wanted, found = (".".join(map(str, each[:2])) for each in (MIN_PYTHON, sys.version_info))
        return f"the server needs Python {wanted} or newer, and this is Python {found}. The client runs here."
    if missing := [name for name in MODULES if find_spec(name) is None]:
        return f"the server's packages are not installed ({', '.join(missing)}). Run: pip install 'tidemap[server]'"
    if int((numpy := version("numpy")).split(".")[0]) < MIN_NUMPY:
        return f"the server needs numpy {MIN_NUMPY} or newer, and this is numpy {numpy}. The client runs here."
    return None
