"""Logging: one line an event on standard error, as text for people or as JSON for programs."""

import json
import logging
import time
from contextvars import ContextVar
from typing import Literal

CHATTY = ("alembic", "httpx", "uvicorn.error", "websockets")
REPORTED = ("sqlalchemy.pool",)
"""What these say of connections that break, with a trace for each, the store says once."""
REVEALING = ("uvicorn.error", "websockets", "httpcore")
"""What these say at level debug has the headers of requests in it, and so keys and cookies."""
NO_REQUEST = "-"
request_id: ContextVar[str] = ContextVar("request_id", default=NO_REQUEST)
"""The id of the request that is answered; it stands in every line that is logged meanwhile."""

Format = Literal["text", "json"]


class TextFormatter(logging.Formatter):
    """`2026-03-02 10:15:00,123 INFO    tidemap.server [id] words`; a trace follows on lines that begin with a space."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)-7s %(name)s%(request)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """The line of a record."""
        known = request_id.get()
        record.request = "" if known == NO_REQUEST else f" [{known}]"
        first, *trace = super().format(record).splitlines() or [""]
        return "\n".join([_visible(first), *(f"  {_visible(line)}" for line in trace)])


class JsonFormatter(logging.Formatter):
    """An object a line: time, level, logger, message, and where there are any request_id, trace and other facts."""

    def format(self, record: logging.LogRecord) -> str:
        """The line of a record."""
        seconds = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        said = {
            "time": f"{seconds}.{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if (known := request_id.get()) != NO_REQUEST:
            said["request_id"] = known
        if record.exc_info:
            said["trace"] = self.formatException(record.exc_info)
        facts: dict[str, object] = getattr(record, "facts", {})
        return json.dumps({**said, **facts}, default=str)


FORMATTERS: dict[str, type[logging.Formatter]] = {"text": TextFormatter, "json": JsonFormatter}


def configure(level: str, form: Format = "text") -> None:
    """Send records of `level` (debug, info, warning, error) and above to standard error."""
    handler = logging.StreamHandler()
    handler.setFormatter(FORMATTERS[form]())
    logging.basicConfig(level=level.upper(), handlers=[handler])
    for name in REVEALING:
        logging.getLogger(name).setLevel(logging.INFO)
    if level.lower() != "debug":
        for name in CHATTY:
            logging.getLogger(name).setLevel(logging.WARNING)
        for name in REPORTED:
            logging.getLogger(name).setLevel(logging.CRITICAL)


def _visible(text: str) -> str:
    r"""Control characters written out: what somebody sends may begin no line of its own, nor colour a terminal.

    >>> print(_visible("/a\r2026 ERROR all is lost"))
    /a\x0d2026 ERROR all is lost
    """
    return text if text.isprintable() else "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)
