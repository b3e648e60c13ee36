"""Stores and contexts on a fresh database of either kind."""

from collections.abc import Iterator

import pytest

from tests.support.contexts import opened
from tidemap.services.context import Context
from tidemap.storage.store import Store


@pytest.fixture
def store(database_url: str) -> Iterator[Store]:
    """An open store on a fresh database."""
    opened_store = Store(database_url)
    yield opened_store
    opened_store.close()


@pytest.fixture
def ctx(database_url: str) -> Iterator[Context]:
    """An open context on a fresh database."""
    with opened(database_url) as context:
        yield context
