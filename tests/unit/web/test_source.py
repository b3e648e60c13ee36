"""What the viewer asks the services for: of locations outside of a key's scope it finds nothing."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.contexts import NOW, make_location, opened, post_rows, refit
from tests.support.databases import SqliteDatabases
from tidemap.errors import LocationNotFoundError
from tidemap.scope import Scope
from tidemap.services.map_view import MapQuery
from tidemap_web.viewer.source import Services


def test_a_limited_key_sees_its_locations_only(tmp_path: Path) -> None:
    with SqliteDatabases(tmp_path).migrated() as url, opened(url) as ctx:
        for name in ("hall", "yard"):
            make_location(ctx, name, (2, 2), estimator="static")
            post_rows(ctx, name, [(NOW - 60, 0, 1), (NOW - 60, 1, 0)])
            refit(ctx, name)
        everything, limited = Services(ctx), Services(ctx, Scope(("hall",)))
        assert [each.name for each in everything.grids()] == ["hall", "yard"]
        assert [each.name for each in limited.grids()] == ["hall"]
        assert (limited.is_location("hall"), limited.is_location("yard")) == (True, False)
        questions: tuple[Callable[[Services, str], object], ...] = (
            lambda source, name: source.grid(name),
            lambda source, name: source.view(MapQuery(name, NOW), None),
            lambda source, name: source.window(MapQuery(name, NOW)),
            lambda source, name: source.load(MapQuery(name, NOW), lambda _: None),
            lambda source, name: source.events(name, 0.0),
        )
        make_location(ctx, "gate", pose={"frame": "map", "position": [0, 0, 0]})
        assert [len(source.posed("map")) for source in (everything, limited)] == [1, 0]
        for ask in questions:
            ask(limited, "hall")
            ask(everything, "yard")
            with pytest.raises(LocationNotFoundError):
                ask(limited, "yard")
