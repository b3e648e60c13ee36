"""Stores and a location on a fresh database of either kind."""

from collections.abc import Iterator
from contextlib import closing

import pytest

from tests.support.rows import VALUES
from tidemap.storage.records import LocationRecord
from tidemap.storage.store import Store


@pytest.fixture
def store(database_url: str) -> Iterator[Store]:
    """An open store on a fresh database."""
    with closing(Store(database_url)) as opened:
        yield opened


@pytest.fixture
def second(database_url: str) -> Iterator[Store]:
    """Another process's store on the same database."""
    with closing(Store(database_url)) as opened:
        yield opened


@pytest.fixture
def location(store: Store) -> LocationRecord:
    """A door that nobody has observed yet."""
    return store.write(lambda work: work.locations.create(VALUES))
