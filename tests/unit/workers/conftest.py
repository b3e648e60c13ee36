"""What the tests of the workers share."""

from collections.abc import Iterator

import pytest

from tests.support.contexts import Clock, opened
from tidemap.services.context import Context


@pytest.fixture
def lively(database_url: str, clock: Clock) -> Iterator[Context]:
    """A context whose workers look around all the time."""
    with opened(database_url, clock, updater=True, updater_interval_s=0.02) as ctx:
        yield ctx
