"""Jobs: each is claimed once, and changes only from the state it is in."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from tests.support.rows import VALUES
from tidemap.errors import JobNotFoundError, LocationNotFoundError
from tidemap.storage.records import LocationRecord
from tidemap.storage.store import Store
from tidemap.storage.work import Work


def queue(store: Store, location: LocationRecord, count: int = 1) -> list[int]:
    def create() -> int:
        return store.write(lambda work: work.jobs.create(location.id, "update", {"order": 3, "start": None}, 5.0)).id

    return [create() for _ in range(count)]


def test_a_new_job_is_queued(store: Store, location: LocationRecord) -> None:
    (number,) = queue(store, location)
    with store.read() as work:
        job = work.jobs.get(number)
    assert (job.location, job.kind, job.state, job.progress) == ("door", "update", "queued", 0.0)
    assert job.request == {"order": 3, "start": None}
    assert (job.created_at, job.finished_at, job.error, job.result) == (5.0, None, None, None)


def test_the_list_begins_with_the_newest(store: Store, location: LocationRecord) -> None:
    gate = store.write(lambda work: work.locations.create({**VALUES, "name": "gate"}))
    one, two, three = queue(store, location), queue(store, gate), queue(store, location)
    with store.read() as work:
        assert [job.id for job in work.jobs.list(None, 10)] == [*three, *two, *one]
        assert [job.id for job in work.jobs.list(None, 2)] == [*three, *two]
        assert [job.id for job in work.jobs.list(two[0], 10)] == one
        assert [job.id for job in work.jobs.list(None, 10, "door")] == [*three, *one]


def test_the_oldest_is_claimed_first_and_once(store: Store, location: LocationRecord) -> None:
    first, other = queue(store, location, 2)
    claimed = store.write(lambda work: work.jobs.claim(frozenset()))
    assert claimed is not None
    assert (claimed.id, claimed.state) == (first, "running")
    assert store.write(lambda work: work.jobs.claim(frozenset({location.id}))) is None
    claimed = store.write(lambda work: work.jobs.claim(frozenset()))
    assert claimed is not None
    assert claimed.id == other
    assert store.write(lambda work: work.jobs.claim(frozenset())) is None


def test_two_processes_never_claim_the_same(store: Store, second: Store, location: LocationRecord) -> None:
    queued = queue(store, location, 24)

    def claim(n: int) -> int | None:
        job = (store, second)[n % 2].write(lambda work: work.jobs.claim(frozenset()))
        return None if job is None else job.id

    with ThreadPoolExecutor(8) as pool:
        claimed = list(pool.map(claim, range(24)))
    while (job := claim(0)) is not None:
        claimed.append(job)
    found = [number for number in claimed if number is not None]
    assert sorted(found) == queued


def test_a_transition_needs_the_expected_state(store: Store, location: LocationRecord) -> None:
    (number,) = queue(store, location)
    assert store.write(lambda work: work.jobs.transition(number, "queued", state="cancelled", finished_at=6.0))
    assert not store.write(lambda work: work.jobs.transition(number, "queued", state="running"))
    assert not store.write(lambda work: work.jobs.transition(number + 1, "queued", state="running"))
    with store.read() as work:
        assert (work.jobs.get(number).state, work.jobs.get(number).finished_at) == ("cancelled", 6.0)


def test_what_a_job_waits_for_is_no_error_and_ends_with_it(store: Store, location: LocationRecord) -> None:
    (number,) = queue(store, location)
    assert store.write(lambda work: work.jobs.note_waiting(number, "a worker"))
    assert not store.write(lambda work: work.jobs.note_waiting(number, "a worker"))
    with store.read() as work:
        assert (work.jobs.get(number).waiting, work.jobs.get(number).error) == ("a worker", None)
    assert store.write(lambda work: work.jobs.transition(number, "queued", state="cancelled", finished_at=6.0))
    assert not store.write(lambda work: work.jobs.note_waiting(number, "a worker"))
    with store.read() as work:
        assert (work.jobs.get(number).waiting, work.jobs.get(number).error) == (None, None)


def begin(number: int, work: Work) -> None:
    work.jobs.transition(number, "queued", state="running")
    work.jobs.progress(work.jobs.get(number).location_id, number, 0.5)


def test_what_was_running_when_the_process_ended_runs_again(store: Store, location: LocationRecord) -> None:
    running, done, waiting = queue(store, location, 3)
    for number in (running, done):
        store.write(partial(begin, number))
    store.write(lambda work: work.jobs.transition(done, "running", state="done", result={"revision": 1}))
    store.write(lambda work: work.jobs.requeue_running())
    with store.read() as work:
        jobs = [work.jobs.get(number) for number in (running, done, waiting)]
    assert [(job.state, job.progress) for job in jobs] == [("queued", 0.0), ("done", 0.5), ("queued", 0.0)]
    assert jobs[1].result == {"revision": 1}


def test_an_unknown_job_is_said_to_be_unknown(store: Store, location: LocationRecord) -> None:
    with store.read() as work, pytest.raises(JobNotFoundError):
        work.jobs.get(1)
    (number,) = queue(store, location)
    store.write(lambda work: work.locations.delete("door"))
    with store.read() as work, pytest.raises(JobNotFoundError):
        work.jobs.get(number)
    with pytest.raises(LocationNotFoundError):
        store.write(lambda work: work.jobs.create(work.locations.get("door").id, "update", {}, 1.0))
