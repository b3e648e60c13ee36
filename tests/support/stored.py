"""Whether what robots saw is stored, all of it and once."""

from collections import Counter
from collections.abc import Collection

import numpy as np
from sqlalchemy import select

from tests.support.here import command
from tests.support.sightings import BASE, LOCATIONS, SAMPLES, Sighting
from tests.support.truth import Truth, put, states_of
from tidemap.client import Client
from tidemap.storage.engine import open_reader
from tidemap.storage.tables import location, observation


def count_stored(url: str) -> int:
    """How many measurements the server at `url` says that it has."""
    with Client(url) as tidemap:
        return sum(tidemap.location(name).get().observations for name in LOCATIONS)


def check_stored(url: str, database_url: str, sure: Collection[Sighting], unsure: int = 0) -> None:
    """Each of `sure` is stored exactly once, and at most `unsure` others are, exactly once; the history is theirs.

    The log is read from the database, the history by way of the API; `tidemap verify` finds nothing wrong.
    """
    verified = command("verify", "--database-url", database_url)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    log = _log(database_url)
    twice = [sighting for sighting, times in log.items() if times != 1]
    assert not twice, f"stored more than once: {twice}"
    lost = set(sure) - set(log)
    assert not lost, f"lost: {sorted(lost)}"
    others = set(log) - set(sure)
    assert len(others) <= unsure, f"nobody relies on: {sorted(others)}"
    assert count_stored(url) == sum(len(sighting.rows) for sighting in log), "counted otherwise than stored"
    with Client(url) as tidemap:
        for name in LOCATIONS:
            _check_history(tidemap, name, [sighting for sighting in log if sighting.location == name])


def _log(database_url: str) -> Counter[Sighting]:
    """How often each is in the log of observations."""
    columns = (observation.c.first_time, observation.c.last_time, observation.c.source, observation.c.measurements)
    query = select(location.c.name, *columns).join(location, location.c.id == observation.c.location_id)
    query = query.where(location.c.name.in_(LOCATIONS))
    engine = open_reader(database_url)
    with engine.connect() as connection:
        rows = connection.execute(query).all()
    engine.dispose()
    for name, first, last, source, measurements in rows:
        sighting = Sighting.at(first)
        times = [time for time, _, _ in sighting.rows]
        assert (name, first, last) == (sighting.location, min(times), max(times))
        assert (source, measurements) == (sighting.source, len(sighting.rows))
    return Counter(Sighting.at(row.first_time) for row in rows)


def _check_history(tidemap: Client, name: str, sightings: Collection[Sighting]) -> None:
    truth: Truth = {}
    for sighting in sightings:
        put(truth, sighting.rows, BASE)
    start, stop = SAMPLES.start, SAMPLES.stop
    for cell in LOCATIONS[name]:
        series = tidemap.location(name).series(cell, float(BASE.time(start)), float(BASE.time(stop)))
        observed = np.where(series.observed < 0, 2, series.observed)
        np.testing.assert_array_equal(observed, states_of(truth, range(cell, cell + 1), start, stop)[0])
