"""What the tests of the workers share."""

from collections.abc import Iterator

import pytest

from app.services.context import Context
from tests.support.contexts import Clock, opened


@pytest.fixture
def lively(sqlite_url: str, clock: Clock) -> Iterator[Context]:
    """A context whose workers look around all the time."""
    with opened(sqlite_url, clock, updater=True, updater_interval_s=0.02) as ctx:
        yield ctx
