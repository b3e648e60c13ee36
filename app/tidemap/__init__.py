"""Tidemap: a map service for robots that live in one place for months.

    from tidemap import Client

The names are imported at their first use: a server that imports a part of the package loads no client.
"""

from typing import TYPE_CHECKING

from tidemap.version import __version__

if TYPE_CHECKING:
    from tidemap.client import AsyncClient, Client
else:

    def __getattr__(name: str) -> object:
        if name in {"AsyncClient", "Client"}:
            from tidemap import client  # noqa: PLC0415

            return getattr(client, name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = ["AsyncClient", "Client", "__version__"]
