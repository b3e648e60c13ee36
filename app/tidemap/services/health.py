"""Health: what keeps the service from working."""

from collections.abc import Callable, Mapping

from sqlalchemy.exc import SQLAlchemyError

from tidemap.errors import SchemaVersionError
from tidemap.services.context import Context


def problems(ctx: Context, alive: Mapping[str, Callable[[], bool]]) -> list[str]:
    """In words, empty when all is well; `alive` has the parts that run in the background."""
    found = [f"the {name} is not running" for name, check in alive.items() if not check()]
    if (outage := ctx.store.outage()) is not None:
        found.append(f"the database cannot be written: {outage}")
    try:
        ctx.store.check_schema()
    except SchemaVersionError as error:
        found.append(str(error))
    except SQLAlchemyError as error:
        found.append(f"the database does not answer: {type(error).__name__}")
    return found
