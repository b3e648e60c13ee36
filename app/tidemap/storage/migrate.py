"""Schema versions: bring a database to this version's schema, or refuse one that is not known."""

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
    config = _config()
    config.attributes["connection"] = connection
    _check_known(connection, config)
    command.upgrade(config, version)


def check_version(connection: Connection) -> None:
    """Raise SchemaVersionError unless the database has exactly this version's schema."""
    config = _config()
    _check_known(connection, config)
    current, head = current_version(connection), ScriptDirectory.from_config(config).get_current_head()
    if current != head:
        raise SchemaVersionError(
            f"The database has schema version {current or 'none'}, this Tidemap needs {head}: run 'tidemap migrate'."
        )


def current_version(connection: Connection) -> str | None:
    """The schema version of the database, None when it has none yet."""
    return MigrationContext.configure(connection).get_current_revision()


def _check_known(connection: Connection, config: Config) -> None:
    current = current_version(connection)
    if current is None:
        return
    try:
        ScriptDirectory.from_config(config).get_revision(current)
    except CommandError:
        raise SchemaVersionError(
            f"The database has schema version {current}, which this Tidemap does not know: "
            "it was written by a newer version. Upgrade Tidemap; nothing was changed."
        ) from None


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", str(_scripts()).replace("%", "%%"))
    return config


def _scripts() -> Path:
    """The migrations: beside this module in an installed wheel, at the project's root in a checkout."""
    here = Path(__file__).resolve().parent
    installed = here / "migrations"
    return installed if installed.is_dir() else here.parents[2] / "alembic"
