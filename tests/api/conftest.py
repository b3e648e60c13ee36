"""The API in this process: fast, with a clock that stands still."""

from collections.abc import Iterator

import pytest

from tests.api.house import NOW, Api, fortnight, open_house
from tests.api.refusals import Untouched, furnished
from tidemap.events.messages import EventMessage


@pytest.fixture(scope="module")
def api(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Api]:
    """One site for all tests of a module; each makes locations of its own."""
    with open_house(tmp_path_factory.mktemp("api")) as house:
        yield house


@pytest.fixture(autouse=True)
def _clock(request: pytest.FixtureRequest) -> Iterator[None]:
    """Put the clock back after a test that moved it."""
    yield
    if "api" in request.fixturenames:
        request.getfixturevalue("api").clock.now = NOW


@pytest.fixture(scope="module")
def door(api: Api) -> str:
    """A door open from 9 to 17 with a fortnight of history, one sample an hour, and a model of order 3; read only."""
    name = api.location(name="door", confidence=0.75, estimator="fft", order=3)
    api.observe(name, *fortnight())
    api.update(name)
    return name


@pytest.fixture(scope="module")
def lab(api: Api) -> str:
    """A grid of 24 cells with a model of order 3; read only.

    Cell 0 is a wall, cell 1 never occupied, cell 2 follows the door, the others were never seen.
    """
    name = api.lab(name="lab", confidence=0.75, estimator="fft", order=3)
    time, state = fortnight()
    api.look(name, *((float(t), [0, 2] if s else [0], [1] if s else [1, 2]) for t, s in zip(time, state, strict=True)))
    api.update(name)
    return name


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Untouched]:
    """A furnished site that refused requests must leave as it was."""
    with open_house(tmp_path_factory.mktemp("bad")) as house, furnished(house) as site:
        yield site


@pytest.fixture
def heard(house: Api) -> Iterator[list[EventMessage]]:
    """The messages of anomalies that the module's `house` has published."""
    messages: list[EventMessage] = []
    unsubscribe = house.ctx.bus.subscribe_own(lambda each: messages.append(each) if each.kind == "anomaly" else None)
    yield messages
    unsubscribe()
