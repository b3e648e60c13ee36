"""Schema versions: bring a database to this version's schema, or refuse one that is not known."""

from functools import cache
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from alembic.util.exc import CommandError
from sqlalchemy import Connection

from tidemap.errors import SchemaVersionError


def migrate(connection: Connection, version: str = "head") -> None:
    """Run the migrations that `connection`'s database lacks up to a schema version, in the transaction it is in."""
    if _checked(connection) == _known().as_revision_number(version):
        return
    config = _config()
    config.attributes["connection"] = connection
    command.upgrade(config, version)


def check_version(connection: Connection) -> None:
    """Raise SchemaVersionError unless the database has exactly this version's schema."""
    current, head = _checked(connection), _known().get_current_head()
    if current != head:
        raise SchemaVersionError(
            f"The database has schema version {current or 'none'}, this Tidemap needs {head}: run 'tidemap migrate'."
        )


def current_version(connection: Connection) -> str | None:
    """The schema version of the database, None when it has none yet."""
    return MigrationContext.configure(connection).get_current_revision()


def _checked(connection: Connection) -> str | None:
    """The schema version of the database. Raises SchemaVersionError unless it is none or one of this Tidemap's."""
    current = current_version(connection)
    try:
        if current is not None:
            _known().get_revision(current)
    except CommandError:
        raise SchemaVersionError(
            f"The database has schema version {current}, which this Tidemap does not know: "
            "it was written by a newer version. Upgrade Tidemap; nothing was changed."
        ) from None
    return current


@cache
def _known() -> ScriptDirectory:
    """The migrations of this version, read once."""
    return ScriptDirectory.from_config(_config())


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", str(_scripts()).replace("%", "%%"))
    return config


def _scripts() -> Path:
    """The migrations: beside this module in an installed wheel, at the project's root in a checkout."""
    here = Path(__file__).resolve().parent
    installed = here / "migrations"
    return installed if installed.is_dir() else here.parents[2] / "alembic"
