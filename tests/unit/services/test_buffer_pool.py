"""Lending: what somebody still has of a value is never written for another, and what is kept is bounded."""

import gc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Barrier

import numpy as np
from numpy.typing import NDArray

from tidemap.services.buffer_pool import BufferPool


@dataclass(frozen=True, eq=False)
class Page:
    memory: NDArray[np.uint8]

    @property
    def n_bytes(self) -> int:
        return self.memory.nbytes


def lender(limit: int = 100) -> BufferPool[Page]:
    return BufferPool(limit)


def make(n_bytes: int = 30) -> Page:
    return Page(np.zeros(n_bytes, np.uint8))


def never() -> Page:
    raise AssertionError("one was free")


def kept(values: BufferPool[Page]) -> list[object]:
    sizes = [item.value.n_bytes for shelf in values._shelves.values() for item in shelf.items]
    assert values.n_bytes == sum(sizes) <= values._shelves.maxsize
    return sorted(values._shelves, key=str)


def test_what_came_back_is_leased_again() -> None:
    values = lender()
    lease = values.lease("a", 1, make)
    value = lease.value
    del lease
    again = values.lease("a", 1, never)
    assert again.value is value
    assert not again.memory.flags.writeable


def test_whatever_is_made_of_the_memory_holds_on_to_it() -> None:
    for hold in (
        lambda memory: memory,
        lambda memory: memory[3:9],
        lambda memory: memory[:8].view(np.float32)[1:],
        lambda memory: memory.data,
        lambda memory: memory.data[4:].cast("b"),
        lambda memory: memoryview(memory.data)[20:],
    ):
        values = lender()
        lease = values.lease("a", 1, make)
        value, held = lease.value, hold(lease.memory)
        del lease
        other = values.lease("a", 1, make)
        assert other.value is not value
        del held
        assert values.lease("a", 1, never).value is value


def test_what_is_forgotten_in_a_circle_comes_back_when_it_is_collected() -> None:
    values = lender()
    circle: list[object] = [values.lease("a", 1, make)]
    circle.append(circle)
    del circle
    gc.collect()
    values.lease("a", 1, never)


def test_another_version_is_made_anew_and_takes_the_location_of_the_one_before() -> None:
    values = lender()
    for version in range(9):
        values.lease("a", version, make)
    assert kept(values) == ["a"]
    assert len(values._shelves["a"].items) == 1


def test_the_least_recently_asked_for_go_first() -> None:
    values = lender()
    for key in "abc":
        values.lease(key, 0, make)
    values.lease("a", 0, never)
    values.lease("d", 0, make)
    assert kept(values) == ["a", "c", "d"]


def test_what_is_dropped_stays_whole_for_who_has_it() -> None:
    values = lender()
    lease = values.lease("a", 0, make)
    lease.value.memory[:] = 7
    for key in "bcde":
        values.lease(key, 0, make)
    assert kept(values) == ["c", "d", "e"]
    assert lease.memory.tolist() == [7] * 30


def test_more_than_the_limit_is_never_kept() -> None:
    values = lender()
    values.lease("a", 0, make)
    assert values.lease("b", 0, lambda: make(101)).memory.size == 101
    assert kept(values) == ["a"]
    nothing = lender(0)
    nothing.lease("a", 0, make)
    assert kept(nothing) == []


def test_of_what_many_have_at_once_as_much_is_kept_as_there_is_room_for() -> None:
    values = lender()
    values.lease("b", 0, make)
    leases = [values.lease("a", 0, make) for _ in range(8)]
    assert kept(values) == ["a"]
    mine = {id(item.value) for item in values._shelves["a"].items}
    assert mine == {id(lease.value) for lease in leases[:3]}
    del leases
    again = [values.lease("a", 0, never) for _ in range(3)]
    assert {id(lease.value) for lease in again} == mine


def test_no_two_have_the_same_at_the_same_time() -> None:
    values, together = lender(10**6), Barrier(8, timeout=60)

    def lease_one(number: int) -> None:
        for _ in range(50):
            lease = values.lease("a", 0, make)
            lease.value.memory[:] = number
            together.wait()
            assert (lease.memory == number).all()
            del lease
            together.wait()

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lease_one, range(8)))
    assert len(values._shelves["a"].items) == 8
