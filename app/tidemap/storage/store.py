"""The store: a database with its readers and its one writer."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from copy import copy
from functools import partial
from pathlib import Path
from typing import TypeVar

from sqlalchemy import Connection, Dialect, make_url
from sqlalchemy.exc import DBAPIError

from tidemap.errors import DatabaseUnusableError, StorageUnavailableError
from tidemap.storage.changes import Changes
from tidemap.storage.engine import open_reader, open_writer
from tidemap.storage.gate import Gate
from tidemap.storage.migrate import check_version, current_version, migrate
from tidemap.storage.outage import OutageTracker, is_outage
from tidemap.storage.partitions import partition, unpartitioned
from tidemap.storage.size import database_bytes
from tidemap.storage.work import Work
from tidemap.storage.writer import Item, RunAll, Writer

Result = TypeVar("Result")
POSTGRES = (14,)
"""The oldest version."""


def migrate_database(url: str) -> None:
    """Bring the database at `url` to this version's schema.

    Raises SchemaVersionError when it is a newer one, DatabaseUnusableError when it cannot be opened.
    """
    with _writing(url) as connection:
        migrate(connection)


def partition_database(url: str, report: Callable[[str], None]) -> list[str]:
    """Put the growing tables that lie in one piece into partitions, each in a transaction of its own; their names.

    Of a PostgreSQL database with this version's schema. What was interrupted goes on where it was; `report` hears of a
    table before it is copied. Raises SchemaVersionError, DatabaseUnusableError.
    """
    with _writing(url) as connection:
        check_version(connection)
        if connection.dialect.name != "postgresql":
            raise DatabaseUnusableError("The embedded database has no partitions: leave --partition out.")
        left = unpartitioned(connection)
    for table in left:
        report(table)
        with _writing(url) as connection:
            partition(connection, table)
    return left


def prepare_database(url: str) -> None:
    """Migrate what nobody else shares, a SQLite file, and what is empty; refuse an outdated shared database.

    Raises SchemaVersionError saying what to do, DatabaseUnusableError when it cannot be opened.
    """
    with _writing(url) as connection:
        if connection.dialect.name == "sqlite" or current_version(connection) is None:
            migrate(connection)
        else:
            check_version(connection)


def require_database(url: str) -> None:
    """Raise DatabaseUnusableError where there is no file of an embedded database; nothing is made."""
    address = make_url(url)
    if address.get_backend_name() == "sqlite" and not Path(address.database or "").is_file():
        raise DatabaseUnusableError(
            f"There is no database: the file {address.database} is not there. Check --data and --database-url; "
            "'tidemap serve' and 'tidemap migrate' make a new one."
        )


@contextmanager
def _writing(url: str) -> Iterator[Connection]:
    """One transaction on a database that nobody has opened yet."""
    engine = open_writer(url)
    try:
        with usable(url), engine.begin() as connection:
            check_server(connection.dialect)
            yield connection
    finally:
        engine.dispose()


def check_server(dialect: Dialect) -> None:
    """Raises DatabaseUnusableError on a PostgreSQL that cannot end an idle session."""
    version = getattr(dialect, "server_version_info", None)
    if dialect.name == "postgresql" and version is not None and version < POSTGRES:
        given = ".".join(map(str, version))
        raise DatabaseUnusableError(f"This is PostgreSQL {given}; use {POSTGRES[0]} or newer.")


@contextmanager
def usable(url: str) -> Iterator[None]:
    """Say which database it was that failed, and not its password."""
    try:
        yield
    except DBAPIError as error:
        raise DatabaseUnusableError(f"The database {shown(url)} cannot be used: {error.orig}") from error


def shown(url: str) -> str:
    """The address of a database as anybody may read it: the password, which may be in its query too, is hidden."""
    address = make_url(url)
    hidden = {name: "***" if name == "password" else value for name, value in address.query.items()}
    return address.set(query=hidden).render_as_string(hide_password=True)


class Store:
    """Open with the URL of a migrated database; SchemaVersionError otherwise."""

    def __init__(self, url: str, commit_queue: int = 1024, commit_batch: int = 128) -> None:
        self._guard: Callable[[Work], None] = lambda work: None
        self._reading = OutageTracker("read")
        self._gate = Gate()
        self._reader = open_reader(url)
        try:
            with usable(url), self._reader.begin() as connection:
                check_version(connection)
        except BaseException:
            self._reader.dispose()
            raise
        self._writer_engine = open_writer(url)
        self._writer = Writer(self._writer_engine, commit_queue, commit_batch, self._gate)

    @contextmanager
    def read(self) -> Iterator[Work]:
        """A unit of work that sees one snapshot and writes nothing. Raises StorageUnavailableError.

        Short ones are better, and it waits for no write inside: the writer may be waiting for it.
        """
        with self._snapshot() as connection:
            yield Work.on(connection)

    def size_bytes(self) -> int:
        """What the database takes on its disk. Raises StorageUnavailableError."""
        with self._snapshot() as connection:
            return database_bytes(connection)

    @contextmanager
    def _snapshot(self) -> Iterator[Connection]:
        try:
            with self._gate.inside(), self._reader.connect() as connection, connection.begin() as transaction:
                yield connection
                transaction.rollback()
        except DBAPIError as error:
            if not is_outage(error):
                raise
            self._reading.failed(error)
            raise StorageUnavailableError from error
        self._reading.worked()

    def check_schema(self) -> None:
        """Raise SchemaVersionError where somebody has changed the schema since the start; about 5 ms."""
        with self._gate.inside(), self._reader.connect() as connection, connection.begin() as transaction:
            check_version(connection)
            transaction.rollback()

    def guarded(self, guard: Callable[[Work], None]) -> "Store":
        """The same store; a write by `submit` or `write` calls `guard` first, and fails with what that raises."""
        other = copy(self)
        other._guard = guard
        return other

    def submit(self, run: Callable[[Work], Result], then: Callable[[Result], None] | None = None) -> Future[Result]:
        """Queue a write; see `Writer.submit`."""
        return self._writer.submit(partial(self._run, run), then)

    def submit_item(
        self, run_all: RunAll[Item, Result], item: Item, then: Callable[[Result], None] | None = None
    ) -> Future[Result]:
        """Queue an item that is written together with others; see `Writer.submit_item`."""
        return self._writer.submit_item(run_all, item, then)

    def submit_deferred(
        self, run_all: RunAll[Item, Result], make: Callable[[], Item], then: Callable[[Result], None] | None = None
    ) -> Future[Result]:
        """Queue an item that is still to be made; see `Writer.submit_deferred`."""
        return self._writer.submit_deferred(run_all, make, then)

    def write(self, run: Callable[[Work], Result], then: Callable[[Result], None] | None = None) -> Result:
        """Queue a write and wait until it is durable; `then` as in `Writer.submit`."""
        return self._writer.submit(partial(self._run, run), then).result()

    def _run(self, run: Callable[[Work], Result], work: Work) -> Result:
        self._guard(work)
        return run(work)

    def slow_down(self, rest_s: float) -> None:
        """Let the writer rest so long after every group commit, from now on: posts wait for it."""
        self._writer.rest_s = rest_s

    def on_commit(self, listener: Callable[[float], object]) -> None:
        """Call `listener`, which only takes note, with the seconds that every group commit takes from now on."""
        self._writer.on_commit = listener

    @property
    def changes(self) -> Changes:
        """Whether what lists of events show is as it was."""
        return self._writer.changes

    def outage(self) -> str | None:
        """Why the database cannot be written, as the last write showed; None when it can."""
        return self._writer.outage.reason

    def waiting(self) -> int:
        """How many writes wait for the writer."""
        return self._writer.waiting()

    def close(self) -> None:
        """Finish the accepted writes and let go of the database; later reads raise an error."""
        self._writer.close()
        self._gate.close()
        self._reader.dispose()
        self._writer_engine.dispose()
