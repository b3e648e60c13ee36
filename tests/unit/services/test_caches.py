"""Caches: bounded in bytes, one version of a key, never in the way of a failing load."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from tidemap.services.caches import ByteCache


def cache(limit: int = 100) -> ByteCache[bytes]:
    return ByteCache(limit, len)


def never() -> bytes:
    raise AssertionError("this was held")


def held(caches: ByteCache[bytes]) -> list[object]:
    assert caches.n_bytes == sum(entry.size for entry in caches._entries.values()) <= caches._limit
    return sorted(caches._entries, key=str)


def test_what_is_held_is_not_loaded_again() -> None:
    values = cache()
    assert values.get("a", 1, lambda: b"x" * 60) == b"x" * 60
    assert values.get("a", 1, never) == b"x" * 60


def test_another_version_takes_the_location_of_the_one_before() -> None:
    values = cache()
    for version in range(9):
        assert values.get("a", version, lambda: b"x" * 60) == b"x" * 60
    assert held(values) == ["a"]
    assert values.get("a", 8, never)


def test_the_least_recently_used_go_first() -> None:
    values = cache()
    for key in "abc":
        values.get(key, 0, lambda: b"x" * 33)
    values.get("a", 0, never)
    values.get("d", 0, lambda: b"x" * 30)
    assert held(values) == ["a", "c", "d"]


def test_what_is_larger_than_the_limit_is_not_kept_and_drives_nothing_out() -> None:
    values = cache()
    values.get("a", 0, lambda: b"x" * 60)
    assert len(values.get("b", 0, lambda: b"x" * 101)) == 101
    assert held(values) == ["a"]
    assert len(values.get("a", 1, lambda: b"x" * 101)) == 101
    assert held(values) == []


def test_what_is_dropped_is_loaded_again() -> None:
    values = cache()
    for key in (("lab", 1), ("lab", 2), ("hall", 1)):
        values.get(key, 0, lambda: b"x" * 20)
    values.drop(lambda key: isinstance(key, tuple) and key[0] == "lab")
    assert held(values) == [("hall", 1)]


def test_a_load_that_fails_leaves_nothing() -> None:
    values = cache()
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            values.get("a", 0, lambda: bytes(1 // 0))
    assert held(values) == []


def test_the_limit_holds_under_many_threads() -> None:
    values = cache(50)

    def use(n: int) -> int:
        size = n % 13
        return len(values.get(("key", n % 7), n % 3, lambda: b"x" * size))

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(use, range(3000)))
    held(values)
