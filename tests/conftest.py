"""Fixtures: real databases, real server processes, a real browser and the paper's data."""

import os
from collections.abc import Generator, Iterator
from typing import Any

import pytest
from hypothesis import settings
from playwright.sync_api import Browser, Page
from threadpoolctl import threadpool_limits

from tests.support.choices import kept_choices
from tests.support.chromium import NAMES, driving, find_chromium, launch
from tests.support.contexts import Clock, opened
from tests.support.databases import Databases, PostgresDatabases, SqliteDatabases
from tests.support.forked import Forked
from tests.support.office import FOLDER, Office, missing, read_office
from tests.support.postgres import Postgres, running_postgres
from tests.support.server import ServerProcess, StartServer
from tidemap.services.context import Context

# What runs in .venv/ros, with the packages that are there.
collect_ignore = ["support/ros2"]
CONSOLE = pytest.StashKey[list[str]]()

# No deadline, for the machine may be busy; the same examples in every run of CI, new ones elsewhere.
settings.register_profile("tidemap", deadline=None, derandomize="CI" in os.environ)
settings.load_profile("tidemap")


@pytest.fixture(scope="session", autouse=True)
def frugal() -> Iterator[None]:
    """What is chosen once for a history is kept; matrices are multiplied on one thread, as in a server."""
    with kept_choices(), threadpool_limits(1, user_api="blas"):
        yield


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """A PostgreSQL server of this test process's own."""
    with running_postgres() as server:
        yield server


@pytest.fixture(scope="session", params=["sqlite", "postgresql"])
def databases(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Databases:
    """Makes databases of one kind; whatever uses it runs once for each kind."""
    if request.param == "sqlite":
        return SqliteDatabases(tmp_path_factory.mktemp("databases"))
    return PostgresDatabases(request.getfixturevalue("postgres"))


@pytest.fixture
def database_url(databases: Databases) -> Iterator[str]:
    """The URL of a fresh database with the current schema."""
    with databases.migrated() as url:
        yield url


@pytest.fixture
def empty_database_url(databases: Databases) -> Iterator[str]:
    """The URL of a fresh database with nothing in it, not even a schema."""
    with databases.empty() as url:
        yield url


@pytest.fixture
def clock() -> Clock:
    """The time of `ctx`."""
    return Clock()


@pytest.fixture
def ctx(database_url: str, clock: Clock) -> Iterator[Context]:
    """An open context on a fresh database."""
    with opened(database_url, clock) as context:
        yield context


@pytest.fixture
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StartServer]:
    """Starts servers: `server("--option", env={...}, database_url=...)`; each on data of its own.

    They are forks of a process that has imported everything, unless `launch` says `fresh`: a quarter of the work.
    """
    yield from _servers(tmp_path_factory)


@pytest.fixture(scope="module")
def module_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StartServer]:
    """As `server`, for servers that all tests of a module share."""
    yield from _servers(tmp_path_factory)


@pytest.fixture(scope="module")
def shared_server(module_server: StartServer) -> ServerProcess:
    """One server for all tests of a module, which must not disturb one another."""
    return module_server()


def _servers(tmp_path_factory: pytest.TempPathFactory) -> Generator[StartServer, None, None]:
    started: list[ServerProcess] = []

    def start(*options: str, **how: Any) -> ServerProcess:
        started.append(ServerProcess(tmp_path_factory.mktemp("server"), *options, **{"launch": Forked, **how}))
        return started[-1]

    try:
        yield start
    finally:
        for process in started:
            if process in ServerProcess.running:
                process.stop()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """A headless Chromium with software WebGL. Use `page`, or drive it within `driving(browser)`."""
    executable = find_chromium()
    if executable is None:
        pytest.fail(f"The browser tests need one of {', '.join(NAMES)} on the PATH: run 'make test'.")
    with launch(executable) as started:
        yield started


@pytest.fixture
def page(browser: Browser, request: pytest.FixtureRequest) -> Iterator[Page]:
    """A page with a profile of its own: no cookie, no storage, nothing cached."""
    said = request.node.stash.setdefault(CONSOLE, [])
    with driving(browser), browser.new_context(viewport={"width": 1280, "height": 800}) as context:
        page = context.new_page()
        page.on("console", lambda message: said.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: said.append(f"uncaught: {error}"))
        yield page


@pytest.fixture(scope="session")
def office() -> Office:
    """The paper's office door; skips where the data are not."""
    if absent := missing():
        pytest.skip(f"no {', '.join(absent)} in {FOLDER}: the paper's data are not part of the project")
    return read_office()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first, those with processes of their own, so that all workers have something to do until the
    end; nothing else is moved."""
    items.sort(key=lambda item: "e2e" not in item.path.parts)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Show the logs of the running servers and the browser's console with a failed test."""
    report = yield
    if report.failed:
        for process in ServerProcess.running:
            report.sections.append((f"log of the server at {process.url}", process.output(60)))
        if said := item.stash.get(CONSOLE, []):
            report.sections.append(("console of the browser", "\n".join(said)))
    return report
