"""A database that the version before made: it migrates, verifies clean, and answers as it did there, on both databases.

`version_before.db.gz`, whose rows are loaded into PostgreSQL too, holds a grid that is partly compacted, with a
revision, an event and a queued job; a `state` that is not compacted; an empty location; a key.
"""

from pathlib import Path

import pytest

from tests.support.contexts import compact_now, opened, refit
from tests.support.version_before import make_version_before
from tidemap.errors import SchemaVersionError
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.checks import LogTotals
from tidemap.services.jobs import list_jobs
from tidemap.services.keys import create_key, list_keys
from tidemap.services.state import StateQuery, state_at
from tidemap.services.verify import Finding, verify
from tidemap.storage.store import Store, migrate_database, prepare_database

HOUR = 3600.0


@pytest.fixture
def outdated(empty_database_url: str, tmp_path: Path) -> str:
    """The database as it was left."""
    make_version_before(empty_database_url, tmp_path)
    return empty_database_url


@pytest.fixture
def url(outdated: str) -> str:
    """The database after `tidemap migrate`."""
    migrate_database(outdated)
    return outdated


def findings(url: str) -> tuple[LogTotals, list[Finding]]:
    found: list[Finding] = []
    return verify(url, found.append), found


def test_a_shared_one_waits_for_its_migration(outdated: str) -> None:
    """Other processes of the version before may still be at it; a file is nobody else's."""
    if outdated.startswith("sqlite"):
        prepare_database(outdated)
        Store(outdated).close()
    else:
        with pytest.raises(SchemaVersionError, match=r"0001.*tidemap migrate"):
            prepare_database(outdated)


def test_it_verifies_clean(url: str) -> None:
    assert findings(url) == (LogTotals(locations=3, blobs=7, observations=4), [])


def test_it_answers_as_before(url: str) -> None:
    with opened(url) as ctx:
        view = state_at(ctx, "lab", StateQuery(50 * HOUR))
        assert (view.revision, view.cell.tolist()) == (1, [0, 3, 7, 1030])
        p = 0.8598670363426208
        assert view.probability.tolist() == pytest.approx([p, 0.0, p, p], abs=1e-6)
        (event,) = list_events(ctx, EventQuery())
        assert (event.start, list(event.cells), event.observed, event.surprise) == (51 * HOUR, [3], 1, 1.0)
        (job,) = list_jobs(ctx, None, 9)
        assert (job.location, job.state) == ("lab", "queued")


def test_it_goes_on_from_there(url: str) -> None:
    with opened(url) as ctx:
        assert refit(ctx, "lab", estimator="fft", order=1).revision == 2
        compact_now(ctx, "door")
        assert create_key(ctx, "new", "robot").id == 2
        assert [key.id for key in list_keys(ctx)] == [1, 2]
    tally, found = findings(url)
    assert (tally.locations, found) == (3, [])
