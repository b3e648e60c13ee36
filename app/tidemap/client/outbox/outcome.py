"""What came of sending a batch."""

from dataclasses import dataclass
from enum import Enum, auto

import httpx
from pydantic import ValidationError

from tidemap.client.address import unreachable
from tidemap.client.errors import TidemapError, problem_of
from tidemap.client.retry import NEVER_SENT
from tidemap.schemas.observations import Accepted


class SendOutcome(Enum):
    """What becomes of the batch."""

    STORED = auto()
    REFUSED = auto()
    WAIT = auto()
    """The batches of its location wait."""
    ALL_WAIT = auto()
    """Nothing can be sent to anybody."""


NOBODY_SERVED = frozenset({401, 407, 429, 502, 503, 504})
"""Statuses that say nothing about this batch: every other would fare the same."""
PASSING = frozenset({403, 408, 425})
"""Statuses below 500 that may pass. 403 does when the key is given the location."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The fate of a batch, and the error if it was not stored."""

    outcome: SendOutcome
    error: TidemapError | None = None


def judge(path: str, reply: httpx.Response | httpx.RequestError) -> Verdict:
    """What came of sending a batch to the location at `path`."""
    if isinstance(reply, httpx.RequestError):
        return Verdict(
            SendOutcome.ALL_WAIT if isinstance(reply, NEVER_SENT) else SendOutcome.WAIT, unreachable(path, reply)
        )
    status = reply.status_code
    if status in (200, 201) and _is_receipt(reply.content):
        return Verdict(SendOutcome.STORED)
    error = problem_of(reply)
    if status < 400:
        # The page of a network that wants a sign-in first, for example: it must not pass for a receipt.
        return Verdict(SendOutcome.ALL_WAIT, TidemapError(status, "No answer of a Tidemap server", error.detail))
    if status in NOBODY_SERVED:
        return Verdict(SendOutcome.ALL_WAIT, error)
    return Verdict(SendOutcome.WAIT if status in PASSING or status >= 500 else SendOutcome.REFUSED, error)


def words(error: TidemapError) -> str:
    """All that the server said."""
    return "; ".join([str(error), *(f"{each.field}: {each.message}" for each in error.errors)])


def _is_receipt(content: bytes) -> bool:
    try:
        Accepted.model_validate_json(content)
    except ValidationError:
        return False
    return True
