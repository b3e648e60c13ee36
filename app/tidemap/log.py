"""Logging: one line a record, plain text on standard error."""

import logging

CHATTY = ("alembic", "httpx", "uvicorn.error", "websockets")
REPORTED = ("sqlalchemy.pool",)
"""What these say of connections that break, with a trace for each, the store says once."""


def configure(level: str) -> None:
    """Send records of `level` (debug, info, warning, error) and above to standard error."""
    logging.basicConfig(level=level.upper(), format="%(asctime)s %(levelname)-7s %(name)s: %(message)s")
    if level.lower() != "debug":
        for name in CHATTY:
            logging.getLogger(name).setLevel(logging.WARNING)
        for name in REPORTED:
            logging.getLogger(name).setLevel(logging.CRITICAL)
