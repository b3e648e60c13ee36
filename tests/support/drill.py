"""A drill: a fleet posts to two servers on one PostgreSQL and a Dask cluster while processes of all kinds die."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import count, cycle
from pathlib import Path
from signal import SIGKILL
from typing import Any

import httpx

from tests.support.cluster import Cluster, running_cluster
from tests.support.databases import PostgresDatabases
from tests.support.filling import fill
from tests.support.fleet import AGAIN_S, EAGER, Fleet, fleet_at_work
from tests.support.postgres import Postgres, running_postgres
from tests.support.server import StartServer
from tests.support.sightings import make_locations
from tests.support.site import Site
from tests.support.waiting import until
from tidemap.client import Client, RetryPolicy, TidemapError
from tidemap.schemas.common import parse_time

ROOMS, WORKERS, BEGUN = 7, 3, 0.15
"""With a door, a laboratory and a hall there are ten locations. BEGUN: progress of an update that has stored chunks."""
LAST_S = 1e9
"""When the last event begins."""
ENVIRONMENT = {"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false"}
UNTIRING = RetryPolicy(tries=10_000, first_s=0.01, max_s=0.2)
Heard = list[Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class Sizes:
    """The cells of the hall that is updated; robots with an outbox and without; their pauses between posts."""

    hall: tuple[int, int, int]
    outboxes: int
    direct: int
    pause_s: float


class Herald:
    """Posts what is abnormal, to one room after the other, each post as often as it takes to hear that it is stored."""

    def __init__(self, client: Client[Any], rooms: list[str]) -> None:
        self._client = client
        self._rooms = rooms
        self.acknowledged: Counter[str] = Counter()

    def run(self, stop: threading.Event, pause_s: float) -> None:
        """Until it is stopped."""
        for number, room in zip(count(), cycle(self._rooms), strict=False):
            if stop.wait(pause_s):
                return
            self.post(room, 100.0 + 2 * number)

    def post(self, room: str, time_s: float) -> None:
        """One event."""
        while True:
            try:
                self._client.location(room).observe([time_s], [1], idempotency_key=f"{room} {time_s}")
            except TidemapError:
                time.sleep(AGAIN_S)
            else:
                self.acknowledged[room] += 1
                return


class Drill:
    """The processes, and what dies of them. `deaths`: what died so far."""

    def __init__(self, sites: list[Site], workers: list[Any], postgres: Postgres) -> None:
        self.sites = sites
        self.deaths: list[str] = []
        self._workers = workers
        self._postgres = postgres

    def update(self, through: Callable[[int], None] = lambda number: None) -> float:
        """Update the hall, `through` whatever happens to its job; the seconds until that is done."""
        began = time.perf_counter()
        number: int = self._asked("/locations/hall/update", "POST")["id"]
        through(number)
        until(lambda: self._job(number)["finished_at"])
        job = self._job(number)
        assert (job["state"], job["error"]) == ("done", None)
        for site in self.sites:
            until(lambda site=site: site.http.get("/locations/hall").json()["revision"] == job["result"]["revision"])  # type: ignore[misc]
        return time.perf_counter() - began

    def update_through_deaths(self) -> float:
        """Update it while a worker, then the leader, then the database is killed; the last two are started again."""
        return self.update(self._kill_all)

    def _kill_all(self, number: int) -> None:
        for kill in (self._kill_worker, self._kill_leader, self._kill_database):
            # What runs again begins anew: it has to get under way each time.
            until(lambda: self._job(number)["progress"] >= BEGUN)
            assert self._job(number)["state"] == "running"
            self.deaths.append(kill(number))
        for site in self.sites:
            if site.server.process.poll() is not None:
                site.server.restart()

    def _kill_worker(self, _: int) -> str:
        self._workers.pop().kill()
        return "worker"

    def _kill_leader(self, number: int) -> str:
        (killed,) = [site for site in self.sites if leads(site)]
        (other,) = [site for site in self.sites if site is not killed]
        killed.server.kill()
        until(lambda: leads(other))
        until(lambda: self._job(number)["progress"] < BEGUN)
        # It is not started again before the end: the update would have ended meanwhile.
        return "leader"

    def _kill_database(self, _: int) -> str:
        self._postgres.end(SIGKILL)
        self._postgres.start()
        return "database"

    def events(self) -> list[int]:
        """The ids of all events, as both servers have them."""
        first, second = (site.anomalies() for site in self.sites)
        assert first == second
        return first

    def _job(self, number: int) -> Any:
        return self._asked(f"/jobs/{number}")

    def _asked(self, path: str, method: str = "GET") -> Any:
        """What a server answers, as soon as one does."""

        def ask() -> Any:
            for site in self.sites:
                with suppress(httpx.HTTPError):
                    answer = site.http.request(method, path, json={} if method == "POST" else None)
                    if answer.is_success:
                        return answer.json()
            return None

        return until(ask)


def leads(site: Site) -> bool:
    """Whether a server does the background work."""
    return site.metric("tidemap_background ") == 1


@contextmanager
def fleet_of_processes(server: StartServer, folder: Path, sizes: Sizes) -> Iterator[Drill]:
    """All of it at work; when the block ends it is held to what robots and listeners rely on.

    Nothing acknowledged is lost or doubled, every event reached a WebSocket of each server once, `verify` is clean.
    """
    with ExitStack() as stack:
        # It survives its own death, and nobody ends the machine.
        postgres = stack.enter_context(running_postgres({"fsync": "off"}))
        url = stack.enter_context(PostgresDatabases(postgres).migrated())
        cluster: Cluster = stack.enter_context(running_cluster(folder))
        workers = [cluster.worker(url) for _ in range(WORKERS)]
        env = ENVIRONMENT | cluster.env
        sites = [stack.enter_context(Site(server(database_url=url, env=env))) for _ in range(2)]
        until(lambda: any(leads(site) for site in sites))
        fill(sites[0], "hall", sizes.hall)
        make_locations(sites[0].server.url)
        rooms = [sites[number % 2].empty_room() for number in range(ROOMS)]
        drill = Drill(sites, workers, postgres)
        pool = stack.enter_context(ThreadPoolExecutor())
        heard = [pool.submit(_listen, site.server.url) for site in sites]
        herald = Herald(stack.enter_context(Client(sites[1].server.url, retry=EAGER)), rooms)
        with _posting(folder, drill, herald, sizes) as fleet:
            yield drill
        _check(drill, fleet, herald, [each.result() for each in heard], url)


@contextmanager
def _posting(folder: Path, drill: Drill, herald: Herald, sizes: Sizes) -> Iterator[Fleet]:
    stop = threading.Event()
    urls = [site.server.url for site in drill.sites]
    robots = fleet_at_work(folder, *urls, outboxes=sizes.outboxes, direct=sizes.direct, pause_s=sizes.pause_s)
    with ThreadPoolExecutor(1) as pool, robots as fleet:
        running: Future[None] = pool.submit(herald.run, stop, sizes.pause_s)
        try:
            yield fleet
        finally:
            stop.set()
            running.result()
            herald.post(next(iter(herald.acknowledged)), LAST_S)


def _listen(url: str) -> Heard:
    """What a WebSocket at a server brings of events, up to the last one; connected again whenever it breaks."""
    found: Heard = []
    with Client(url, retry=UNTIRING) as client:
        for message in client.events(kind="anomaly", after=0):
            found.append(message.data)
            if parse_time(message.data["start"]) >= LAST_S:
                break
    return found


def _check(drill: Drill, fleet: Fleet, herald: Herald, heard: list[Heard], url: str) -> None:
    for site in drill.sites:
        fleet.check(site.server.url, url)
        stored = {room: len(site.anomalies(location=room)) for room in herald.acknowledged}
        assert stored == herald.acknowledged
        assert "Traceback" not in site.server.output()
    for messages in heard:
        # Every event is new once; what becomes of it later is another message.
        assert sorted(each["id"] for each in messages if not each["update"]) == drill.events()
        changes = [each["change"] for each in messages]
        assert changes == sorted(set(changes))
