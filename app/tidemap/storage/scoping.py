"""Scopes as conditions of queries."""

from typing import Any

from sqlalchemy import ColumnElement, false, func, or_, true

from tidemap.scope import Scope


def inside(name: ColumnElement[str], scope: Scope) -> ColumnElement[Any]:
    """Whether a location's name is inside; LIKE would take a and A for the same in SQLite."""
    if not scope.limited:
        return true()
    begins = (func.substr(name, 1, len(prefix)) == prefix for prefix in scope.prefixes)
    return or_(false(), name.in_(scope.names), *begins)
