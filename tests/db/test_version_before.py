"""A database that the version before made: it opens, migrates, verifies clean, and answers as it did there.

`version_before.db.gz` holds a grid that is partly compacted, with a revision, an event and a queued job; a `state`
that is not compacted; an empty location; a key.
"""

import gzip
from pathlib import Path

import pytest

from tests.support.contexts import compact_now, opened, refit
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.checks import LogTotals
from tidemap.services.jobs import list_jobs
from tidemap.services.state import StateQuery, state_at
from tidemap.services.verify import Finding, verify
from tidemap.storage.store import prepare_database

MADE = Path(__file__).with_name("version_before.db.gz")
HOUR = 3600.0


@pytest.fixture
def url(tmp_path: Path) -> str:
    """The database, prepared as a server does it."""
    file = tmp_path / "tidemap.db"
    file.write_bytes(gzip.decompress(MADE.read_bytes()))
    address = f"sqlite:///{file}"
    prepare_database(address)
    return address


def findings(url: str) -> tuple[LogTotals, list[Finding]]:
    found: list[Finding] = []
    return verify(url, found.append), found


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
    tally, found = findings(url)
    assert (tally.locations, found) == (3, [])
