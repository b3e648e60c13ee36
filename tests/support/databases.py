"""Fresh databases for tests, one kind a class, made by copying a migrated one."""

import shutil
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Protocol

from tests.support.postgres import Postgres


class Databases(Protocol):
    """Makes databases that live as long as the `with` block that asked for them."""

    def empty(self) -> AbstractContextManager[str]:
        """The URL of a database with nothing in it."""

    def migrated(self) -> AbstractContextManager[str]:
        """The URL of a database with the current schema and no rows."""


class SqliteDatabases:
    """SQLite files in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._numbers = count(1)

    @contextmanager
    def empty(self) -> Iterator[str]:
        """A file that does not exist yet, in a folder of its own."""
        folder = self._folder / str(next(self._numbers))
        folder.mkdir()
        yield f"sqlite:///{folder / 'tidemap.db'}"

    @contextmanager
    def migrated(self) -> Iterator[str]:
        """A copy of the migrated file."""
        with self.empty() as url:
            shutil.copyfile(self._template, url.removeprefix("sqlite:///"))
            yield url

    @cached_property
    def _template(self) -> Path:
        path = self._folder / "template.db"
        migrate_to_head(f"sqlite:///{path}")
        return path


class PostgresDatabases:
    """Databases of a PostgreSQL server."""

    def __init__(self, server: Postgres) -> None:
        self._server = server

    @contextmanager
    def empty(self) -> Iterator[str]:
        """A copy of PostgreSQL's own template."""
        yield from self._copy_of("template0")

    @contextmanager
    def migrated(self) -> Iterator[str]:
        """A copy of the migrated database."""
        yield from self._copy_of(self._template)

    def _copy_of(self, template: str) -> Iterator[str]:
        name = self._server.create(template)
        try:
            yield self._server.url(name)
        finally:
            self._server.drop(name)

    @cached_property
    def _template(self) -> str:
        name = self._server.create()
        migrate_to_head(self._server.url(name))
        return name


def migrate_to_head(url: str) -> None:
    """Give a database the current schema and leave no connection behind."""
    from tidemap.storage.engine import open_writer
    from tidemap.storage.migrate import migrate

    engine = open_writer(url)
    with engine.begin() as connection:
        migrate(connection)
    engine.dispose()
