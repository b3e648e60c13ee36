"""Sharding by location: what the server asks PostgreSQL is about one location, but for what the table here names."""

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from sqlalchemy import Engine, event

from tests.api.house import Api, open_house
from tests.api.refusals import furnished
from tests.api.routes import TABLE, ask
from tests.support.databases import PostgresDatabases
from tests.support.postgres import Postgres
from tests.support.waiting import until
from tidemap.services.keys import create_key
from tidemap.storage.tables import metadata

OWNED = sorted(table.name for table in metadata.sorted_tables if "location_id" in table.c)
"""Tables of what belongs to a location."""
MENTIONED = r"\b(?:FROM|JOIN|UPDATE|INTO) {table}\b"
ONE = r"{table}\.location_id = %\(\w+\)s"
ACROSS = {
    "the summary of locations with their open events": r"AS open FROM anomaly .*GROUP BY anomaly.location_id",
    "the summary of locations with their revisions": r"FROM revision JOIN location ON .* AND location.revision = ",
    "the times of the latest updates, for monitoring": r"FROM location LEFT OUTER JOIN revision ON",
    "since when those of a page are silent": r"FROM rhythm JOIN anomaly ON anomaly.location_id = rhythm.location_id ",
    "whose event has an id": r"SELECT anomaly.location_id FROM anomaly WHERE anomaly.id = ",
    "the number of the latest change": r"SELECT max\(anomaly.change\)",
    "events of all locations, as a list": r"FROM anomaly WHERE anomaly.part_of IS NULL .*BY anomaly.id (DESC )?LIMIT",
    "events of all locations, since one that was heard": r"FROM anomaly WHERE .*anomaly.(id|change) > .* LIMIT",
    "when events end": r"min\(anomaly.stop\) .* GROUP BY anomaly.location_id",
    "whose snooze is over": r"FROM anomaly WHERE anomaly.snoozed_until <= ",
    "whose job has an id": r"SELECT job.location_id FROM job WHERE job.id = ",
    "jobs of all locations, as a list": r"FROM job JOIN location .*ORDER BY job.id DESC LIMIT",
    "whether a job is queued": r"SELECT job.id FROM job WHERE job.state = \S+ LIMIT",
    "the next queued job": r"FROM job JOIN location .* WHERE job.state = \S+ .*ORDER BY job.id LIMIT",
    "what ran when a leader ended": r"UPDATE job SET state=\S+ progress=\S+ WHERE job.state = ",
    "how much waits to be compacted": r"sum\(observation.measurements\) .* GROUP BY observation.location_id",
    "how often locations speak": r"FROM rhythm$",
}
"""What may be asked of all locations at once: lists, what the leader does next, and whose a number in an address is."""


class Statements:
    """What is run on PostgreSQL, each in one line and once."""

    def __init__(self) -> None:
        self.heard: set[str] = set()

    def hear(self, connection: Any, _cursor: Any, statement: str, *_: Any) -> None:
        if connection.dialect.name == "postgresql":
            self.heard.add(" ".join(statement.split()))

    def unknown(self) -> list[str]:
        """Those that are not about one location, and not in `ACROSS`."""
        some = filter(crosses, sorted(self.heard))
        return [each for each in some if not any(re.search(known, each) for known in ACROSS.values())]

    def unheard(self) -> list[str]:
        """What in `ACROSS` was not run."""
        return [why for why, known in ACROSS.items() if not any(re.search(known, each) for each in self.heard)]


def crosses(statement: str) -> bool:
    """Whether a statement names a table of what belongs to locations, and not one location there."""
    if statement.startswith("INSERT"):
        return False
    named = [table for table in OWNED if re.search(MENTIONED.format(table=table), statement)]
    return not all(re.search(ONE.format(table=table), statement) for table in named)


@contextmanager
def listening() -> Iterator[Statements]:
    statements = Statements()
    event.listen(Engine, "before_cursor_execute", statements.hear)
    yield statements
    event.remove(Engine, "before_cursor_execute", statements.hear)


def walk(api: Api) -> None:
    """Every page, and every route of the API, in a house with a door and a lab."""
    pages = ("/", "/fragments/locations", "/fragments/anomalies", "/locations/door", "/fragments/locations/door")
    for page in (*pages, "/fragments/locations/door/anomalies", "/fragments/locations/door/work", "/metrics"):
        api.http.request("GET", page)
    for path in ("/state?bbox=10,20,0,12,21,1&observed=true", "/export?format=ply", "/information", "/model?cell=1"):
        api.get(f"/locations/lab{path}")
    api.location(name="spare-admin")
    api.http.sign_in(create_key(api.ctx, "own", "admin").key)
    for method, path, form, _ in TABLE:
        if not path.startswith("/events"):
            ask(api, method, path, form, "admin")


def test_what_is_asked_is_about_one_location(postgres: Postgres, tmp_path: Path) -> None:
    background = {"updater": True, "updater_interval_s": 0.1}
    with (
        PostgresDatabases(postgres).migrated() as url,
        listening() as statements,
        open_house(tmp_path, url, **background) as api,
        furnished(api),
    ):
        walk(api)
        with suppress(AssertionError):  # what was not heard is said below
            until(lambda: not statements.unheard())
    assert statements.unknown() == []
    assert statements.unheard() == []
