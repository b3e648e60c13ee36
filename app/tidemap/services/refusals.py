"""Refusals: count the posts that are refused for what they say, so that a robot that says it wrong is seen."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress

from tidemap.errors import (
    BodyTooLargeError,
    BusyError,
    DomainError,
    IdempotencyConflictError,
    InvalidInputError,
    UnreadableBodyError,
    UnsupportedMediaTypeError,
)
from tidemap.services.context import Context
from tidemap.storage.work import Work

MAX_REASON = 300
"""Characters that are kept of what is wrong with a post."""
COUNTED = (
    UnreadableBodyError,
    UnsupportedMediaTypeError,
    BodyTooLargeError,
    InvalidInputError,
    IdempotencyConflictError,
)
"""What is wrong with a post itself, and not with who sends it or with this moment."""


@contextmanager
def counting(ctx: Context, location: str, source: str | None) -> Iterator[None]:
    """Counts a post that is refused within."""
    try:
        yield
    except COUNTED as error:
        # Who posts does not wait for it, and a server in trouble has other things to store.
        with suppress(BusyError):
            _count(ctx, location, source, error)
        raise


def _count(ctx: Context, location: str, source: str | None, error: DomainError) -> None:
    at, reason = ctx.clock(), str(error)[:MAX_REASON].replace("\0", "")

    def count(work: Work) -> None:
        work.sources.refuse(work.locations.get(location).id, source or "", at, reason)

    ctx.store.submit(count)
