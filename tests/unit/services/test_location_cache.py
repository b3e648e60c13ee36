"""Location cache: records that are read once a second at most, and anew once this process changes one."""

from typing import Any, cast

from tidemap.services.location_cache import BELIEVED_S, LocationCache
from tidemap.storage.records import LocationRecord


class Readings:
    """A table of locations that counts how often it is read."""

    def __init__(self) -> None:
        self.count = 0
        self.now = 0.0
        self.locations = LocationCache(lambda: self.now, most=3)

    def read(self, name: str) -> LocationRecord:
        self.count += 1
        return cast(LocationRecord, (name, self.count))

    def get(self, name: str = "door") -> Any:
        return self.locations.get(name, self.read)

    def lately(self, name: str = "door") -> Any:
        return self.locations.lately(name)


def test_a_record_is_read_once_in_a_while() -> None:
    readings = Readings()
    assert readings.get() == readings.get() == ("door", 1)
    readings.now += BELIEVED_S
    assert readings.get() == ("door", 2)


def test_what_was_read_long_ago_is_known_until_something_changes() -> None:
    readings = Readings()
    assert readings.locations.lately("door") is None
    readings.get()
    readings.now += 100 * BELIEVED_S
    assert readings.lately() == ("door", 1)
    readings.locations.forget()
    assert readings.locations.lately("door") is None


def test_after_a_change_it_is_read_anew() -> None:
    readings = Readings()
    readings.get()
    readings.locations.forget()
    assert readings.get() == ("door", 2)


def test_what_was_read_before_a_change_is_not_believed_after_it() -> None:
    readings = Readings()

    def read(name: str) -> LocationRecord:
        record = readings.read(name)
        readings.locations.forget()
        return record

    found: Any = readings.locations.get("door", read)
    assert found == ("door", 1)
    assert readings.get() == ("door", 2)


def test_so_many_are_known_and_no_more() -> None:
    readings = Readings()
    for name in ("a", "b", "c", "d", "a", "d"):
        readings.get(name)
    assert readings.count == 5
