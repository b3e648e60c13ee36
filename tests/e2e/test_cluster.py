"""Updates on a Dask cluster of real processes, and what becomes of them when one of those dies."""

import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Event, Thread

import pytest
from sqlalchemy import create_engine, select

from tests.support.cluster import Cluster, running_cluster
from tests.support.contexts import Clock, at_work, elected, make_location, opened, post_rows
from tests.support.databases import SqliteDatabases
from tests.support.drill import Sizes, fleet_of_processes
from tests.support.server import StartServer
from tests.support.tasks import Held, die, hold, negate, refuse
from tests.support.waiting import until
from tidemap.errors import ClusterUnavailableError, NotLeaderError, ShuttingDownError, WorkersDiedError
from tidemap.services.jobs import get_job, request_update
from tidemap.services.locations import find_location
from tidemap.services.update import UpdateRequest, run_update
from tidemap.storage.tables import spectrum
from tidemap.version import __version__
from tidemap.workers import dask_executor
from tidemap.workers.dask_executor import DaskExecutor
from tidemap.workers.dask_worker import serve_cluster
from tidemap.workers.executors import LocalExecutor
from tidemap.workers.updater import Updater


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A database for tasks that need none."""
    with SqliteDatabases(tmp_path_factory.mktemp("tasks")).migrated() as url:
        yield url


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler."""
    with running_cluster(tmp_path_factory.mktemp("cluster")) as cluster:
        yield cluster


@contextmanager
def executing(cluster: Cluster) -> Iterator[DaskExecutor]:
    executor = DaskExecutor(cluster.address)
    try:
        yield executor
    finally:
        executor.close()


def begun(folder: Path) -> list[tuple[int, int]]:
    """Number and process of every task that has begun in a folder."""
    names = (path.name.split("-") for path in folder.glob("begun-*"))
    return sorted((int(number), int(process)) for _, number, process in names)


def once_begun(folder: Path, act: Callable[[], None]) -> Thread:
    """A thread that acts as soon as a task has begun in a folder."""

    def run() -> None:
        until(lambda: begun(folder))
        act()

    thread = Thread(target=run)
    thread.start()
    return thread


def spectra(url: str, revision: int) -> list[tuple[object, ...]]:
    """The rows of a revision but for its number."""
    engine = create_engine(url)
    columns = [column for column in spectrum.c if column.name != "revision"]
    with engine.connect() as connection:
        found = connection.execute(select(*columns).where(spectrum.c.revision == revision).order_by(spectrum.c.chunk))
        rows = [tuple(row) for row in found]
    engine.dispose()
    return rows


def test_the_cluster_stores_the_bytes_that_threads_store(cluster: Cluster, database_url: str, clock: Clock) -> None:
    with opened(database_url, clock) as ctx, ExitStack() as stack:
        make_location(ctx, "lab", (80, 40))
        post_rows(ctx, "lab", [(60.0 * n, cell, n % 3 == 0) for n in range(200) for cell in (7, 1500, 3000)])
        local = LocalExecutor(ctx, 2)
        stack.callback(local.close)
        stack.callback(cluster.worker(database_url).terminate)
        rows = []
        for executor in (local, stack.enter_context(executing(cluster))):
            request = UpdateRequest(estimator="fft", order=2)
            revision = run_update(ctx, find_location(ctx, "lab").id, request, executor, lambda _: None)
            rows.append(spectra(database_url, revision.revision))
    by_threads, by_cluster = rows
    assert len(by_threads) == 4
    assert by_cluster == by_threads


def test_tasks_of_a_killed_worker_run_on_another_one(cluster: Cluster, url: str, tmp_path: Path) -> None:
    first, second = cluster.worker(url), cluster.worker(url)
    with executing(cluster) as executor:
        results = executor.map(hold, [Held(tmp_path, number) for number in range(4)])
        done: list[int] = []
        running = Thread(target=lambda: done.extend(results))
        running.start()
        until(lambda: len(begun(tmp_path)) == 4)
        lost = [number for number, process in begun(tmp_path) if process == first.pid]
        assert len(lost) == 2
        first.kill()
        (tmp_path / "go").touch()
        running.join()
    assert done == list(range(4))
    assert {(number, second.pid) for number in lost} <= set(begun(tmp_path))
    second.terminate()
    second.wait()


def test_results_in_order_errors_to_the_caller_and_an_end(cluster: Cluster, url: str, tmp_path: Path) -> None:
    worker = cluster.worker(url)
    with executing(cluster) as executor:
        assert list(executor.map(negate, range(200))) == [-number for number in range(200)]
        for error in (NotLeaderError(), OSError("bad"), ValueError("bad")):
            with pytest.raises(type(error), match=f"^{error}$"):
                list(executor.map(refuse, [error]))
        results = iter(executor.map(hold, [Held(tmp_path, number) for number in range(10)]))
        stopping = once_begun(tmp_path, executor.request_stop)
        with pytest.raises(ShuttingDownError):
            next(results)
        stopping.join()
        with pytest.raises(ShuttingDownError):
            list(executor.map(negate, [1]))
    (tmp_path / "go").touch()
    worker.terminate()
    assert worker.wait() == 0
    assert len(begun(tmp_path)) < 10


def test_a_lost_scheduler_is_found_again(url: str, tmp_path: Path) -> None:
    with running_cluster(tmp_path) as cluster, executing(cluster) as executor:
        cluster.worker(url)
        assert list(executor.map(negate, [1])) == [-1]
        results = iter(executor.map(hold, [Held(tmp_path, 0)]))
        stopping = once_begun(tmp_path, cluster.stop_scheduler)
        with pytest.raises(ClusterUnavailableError, match="does not answer"):
            next(results)
        stopping.join()
        with pytest.raises(ClusterUnavailableError):
            list(executor.map(negate, [1]))
        (tmp_path / "go").touch()
        cluster.start_scheduler()
        assert list(executor.map(negate, [2])) == [-2]


def test_a_scheduler_that_is_silent_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_executor, "CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        executor = DaskExecutor(f"tcp://127.0.0.1:{silent.getsockname()[1]}")
        with pytest.raises(ClusterUnavailableError):
            list(executor.map(negate, [1]))
        executor.close()
        with pytest.raises(ShuttingDownError):
            list(executor.map(negate, [1]))


def test_a_scheduler_that_falls_silent_and_has_no_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(dask_executor, "ASK_S", 0.2)
    with running_cluster(tmp_path) as cluster, executing(cluster) as executor:
        results = executor.map(negate, [1])

        def freeze() -> None:
            until(lambda: "No `tidemap worker`" in caplog.text)
            cluster.freeze_scheduler()

        waiting = Thread(target=freeze)
        waiting.start()
        with pytest.raises(ClusterUnavailableError):
            next(iter(results))
        waiting.join()
    assert caplog.text.count("No `tidemap worker`") == 1
    assert caplog.text.count("does not answer") == 1


def test_a_job_says_that_it_waits_for_a_worker(cluster: Cluster, url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_executor, "ASK_S", 0.2)
    with opened(url, dask_scheduler=cluster.address) as ctx, elected(ctx) as election, at_work(Updater(ctx, election)):
        make_location(ctx, "waits", (8, 8))
        post_rows(ctx, "waits", [(60.0 * n, 7, n % 3 == 0) for n in range(20)])
        number = request_update(ctx, "waits", UpdateRequest(estimator="static")).id
        waiting = until(lambda: get_job(ctx, number).waiting)
        assert waiting.startswith(f"No `tidemap worker` of version {__version__} is at the Dask cluster")
        assert get_job(ctx, number).error is None
        worker = cluster.worker(url)
        until(lambda: get_job(ctx, number).finished_at)
        done = get_job(ctx, number)
        assert (done.state, done.waiting, done.error) == ("done", None, None)
    worker.terminate()
    worker.wait()


def test_a_task_that_kills_its_workers_is_given_up_with_a_word_to_its_location(url: str, tmp_path: Path) -> None:
    allowed = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
    with running_cluster(tmp_path, allowed) as cluster, executing(cluster) as executor:
        cluster.worker(url)
        with pytest.raises(WorkersDiedError, match=r"began 7 died before its end, the last one at tcp://.*give them"):
            list(executor.map(die, [7]))


def test_what_keeps_a_worker_from_joining_ends_neither_it_nor_its_search(
    url: str, caplog: pytest.LogCaptureFixture
) -> None:
    stop = Event()
    with opened(url) as ctx:
        serving = Thread(target=serve_cluster, args=(ctx, "tcp://127.0.0.1:no-port", stop))
        serving.start()
        until(lambda: caplog.text.count("no worker of the Dask cluster") >= 2)
        stop.set()
        serving.join()


def test_a_fleet_outlives_a_worker_a_leader_and_the_database(server: StartServer, tmp_path: Path) -> None:
    """Ten locations, robots at two servers, three workers: whatever dies in the midst of an update."""
    with fleet_of_processes(server, tmp_path, Sizes(hall=(100, 50, 20), outboxes=4, direct=2, pause_s=0.2)) as drill:
        drill.update_through_deaths()
    assert drill.deaths == ["worker", "leader", "database"]
