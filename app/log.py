"""Logging: one line a record, plain text on standard error."""

import logging

CHATTY = ("alembic", "httpx", "uvicorn.error", "websockets")


def configure(level: str) -> None:
    """Send records of `level` (debug, info, warning, error) and above to standard error."""
    logging.basicConfig(level=level.upper(), format="%(asctime)s %(levelname)-7s %(name)s: %(message)s")
    if level.lower() != "debug":
        for name in CHATTY:
            logging.getLogger(name).setLevel(logging.WARNING)
