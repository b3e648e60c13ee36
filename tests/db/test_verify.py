"""`verify` finds every kind of damage and names where it is; a database in order is in order."""

import zlib
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from sqlalchemy import Connection, create_engine, make_url, text

from tests.support.contexts import compact_now, make_location, post_rows, post_states, refit
from tests.support.truth import measurements_of
from tidemap.errors import DatabaseUnusableError, SchemaVersionError
from tidemap.history.segment import Segment
from tidemap.history.timebase import TimeBase
from tidemap.services.checks import LogTotals
from tidemap.services.context import Context
from tidemap.services.jobs import request_update
from tidemap.services.keys import create_key
from tidemap.services.locations import find_location
from tidemap.services.update import UpdateRequest
from tidemap.services.verify import Finding, verify
from tidemap.spectral.spectrum import static
from tidemap.storage.blobs import pack_cells, pack_measurements, pack_segment, pack_spectrum
from tidemap.storage.codec import seal, unseal

LAB = "(SELECT id FROM location WHERE name = 'lab')"


@pytest.fixture
def url(ctx: Context) -> str:
    """A database with some of everything: two chunks, compacted and pending posts, events, a job, a key."""
    make_location(ctx, "lab", (40, 40), min_cells=1, confidence=0.8)
    post_rows(ctx, "lab", [(60.0 * n, cell, 0) for n in range(4) for cell in (0, 1030)], idempotency_key="a")
    post_rows(ctx, "lab", [(0.0, 3, 0), (30.0, 3, 1)])
    refit(ctx, "lab", estimator="static")
    post_rows(ctx, "lab", [(300.0, 0, 1)], idempotency_key="b")
    post_rows(ctx, "lab", [(360.0, 1599, 1)], idempotency_key="c")
    make_location(ctx, "door")
    post_states(ctx, "door", [0.0, 60.0], [0, 1])
    make_location(ctx, "empty")
    request_update(ctx, "lab", UpdateRequest())
    create_key(ctx, "robot", "robot")
    assert ctx.settings.database_url is not None
    return ctx.settings.database_url


@contextmanager
def behind_its_back(url: str) -> Iterator[Connection]:
    """A connection that does not heed foreign keys."""
    engine = create_engine(make_url(url))
    with engine.begin() as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(text("SET session_replication_role = replica"))
        yield connection
    engine.dispose()


def findings(url: str) -> list[str]:
    found: list[Finding] = []
    verify(url, found.append)
    return [str(finding) for finding in found]


def test_a_database_in_order_is_in_order(url: str) -> None:
    found: list[Finding] = []
    assert verify(url, found.append) == LogTotals(locations=3, blobs=8, observations=5)
    assert found == []


def test_an_empty_database_is_in_order(database_url: str) -> None:
    assert verify(database_url, lambda finding: pytest.fail(str(finding))) == LogTotals()


def test_it_is_in_order_after_everything_is_compacted(ctx: Context, url: str) -> None:
    for name in ("lab", "door", "empty"):
        compact_now(ctx, name)
    assert findings(url) == []


@pytest.mark.parametrize(
    ("statement", "says"),
    [
        ("UPDATE location SET grid = '{' WHERE name = 'lab'", "location 'lab', settings: they cannot be read"),
        ("UPDATE location SET grid = NULL WHERE name = 'lab'", "location 'lab', settings: its kind and its grid"),
        (
            "UPDATE location SET kind = 'grid9d' WHERE name = 'lab'",
            "they cannot be read: 'grid9d' is no kind of location",
        ),
        ("UPDATE location SET kind = 'state' WHERE name = 'lab'", "location 'lab', settings: its kind and its grid"),
        ("UPDATE location SET compacted_seq = 9 WHERE name = 'lab'", "counters: 9 of 4 observations are compacted"),
        (
            "UPDATE location SET compacted_seq = 3 WHERE name = 'lab'",
            "location 'lab', observation 3: it is both compacted and pending",
        ),
        (
            "UPDATE location SET compacted_seq = 1 WHERE name = 'lab'",
            "location 'lab', observation 2: it is pending, but its payload is gone",
        ),
        (f"DELETE FROM observation WHERE id = 3 AND location_id = {LAB}", "observation 4: the log goes from 2 to 4"),
        (
            f"DELETE FROM observation WHERE id = 4 AND location_id = {LAB}",
            "lab', log: it ends with observation 3, but 4",
        ),
        (
            f"DELETE FROM observation WHERE id < 4 AND location_id = {LAB}",
            "log: it begins with observation 4, but only 2",
        ),
        (
            "UPDATE location SET observation_seq = 7 WHERE name = 'door'",
            "door', log: it ends with observation 1, but 7",
        ),
        (
            "UPDATE location SET measurements = 5 WHERE name = 'lab'",
            "log: it holds 12 measurements, but 5 were counted",
        ),
        ("UPDATE location SET measurements = 55 WHERE name = 'lab'", "log: it holds 12 measurements, but 55 were"),
        ("UPDATE location SET measurements = 5 WHERE name = 'lab'", "history: 9 measurements stand, but only 5 were"),
        (
            "UPDATE location SET last_time = 300 WHERE name = 'lab'",
            "observation 4: its times are not those that the loc",
        ),
        (
            "UPDATE observation SET measurements = 2 WHERE id = 4",
            "observation 4: its contents do not fit: it holds 1 mea",
        ),
        ("UPDATE observation SET first_time = 2 WHERE id = 4", "observation 4: its contents do not fit: its times are"),
        ("UPDATE observation SET body_hash = NULL WHERE id = 4", "observation 4: it has an idempotency key without"),
        (
            "UPDATE observation SET payload = substr(payload, 1, 20) WHERE id = 4",
            "observation 4: its checksum is wrong",
        ),
        (
            "UPDATE history SET payload = substr(payload, 1, 4) WHERE chunk = 1",
            "history chunk 1, segment 0: it is cut sh",
        ),
        ("UPDATE history SET chunk = 2 WHERE chunk = 1", "history chunk 2, segment 0: the location has 2 chunks"),
        (
            "UPDATE history SET segment = 5",
            "history chunk 0, segment 5: its contents do not fit: its times are not asc",
        ),
        ("DELETE FROM revision", "location 'lab', revision 1: it is missing"),
        ("UPDATE revision SET recipe = '{}'", "location 'lab', revision 1: it is cut short"),
        ("UPDATE revision SET measurements = 99", "revision 1: its contents do not fit: it was fitted on more than"),
        ("UPDATE revision SET stop = start", "revision 1: its contents do not fit: its window is empty"),
        ("UPDATE revision SET revision = 2", "revision 2: the location's revision is 1"),
        ("DELETE FROM spectrum WHERE chunk = 1", "location 'lab', spectrum chunk 1 of revision 1: it is missing"),
        ("UPDATE spectrum SET chunk = 7 WHERE chunk = 1", "spectrum chunk 7 of revision 1: the location has 2 chunks"),
        ("UPDATE spectrum SET payload = substr(payload, 1, 9) WHERE chunk = 1", "chunk 1 of revision 1: its checksum"),
        ("UPDATE anomaly SET cells = substr(cells, 1, 9)", "location 'lab', anomaly 1: its checksum is wrong"),
        ("UPDATE anomaly SET stop = start - 1", "location 'lab', anomaly 1: its contents do not fit: its start and"),
        ("UPDATE job SET request = '{'", "location 'lab', job 1: its contents do not fit"),
        ("UPDATE job SET state = 'lost'", "location 'lab', job 1: its contents do not fit: its state is 'lost'"),
        ("UPDATE counter SET value = 0 WHERE name = 'job'", "counter job: it stands at 0, but 1 is in use"),
        ("UPDATE api_key SET role = 'king'", "API key 1: its hash or its role cannot be"),
        ("UPDATE anomaly SET location_id = 77", "table anomaly: 1 rows of location 77, which does not exist"),
        ("UPDATE job SET location_id = 77", "table job: 1 rows of location 77, which does not exist"),
        ("UPDATE spectrum SET location_id = 77", "table spectrum: 2 rows of location 77, which does not exist"),
        ("UPDATE observation SET location_id = 77 WHERE id = 2", "table observation: 1 rows of location 77"),
    ],
)
def test_damage_is_found_and_named(url: str, statement: str, says: str) -> None:
    with behind_its_back(url) as connection:
        assert connection.execute(text(statement)).rowcount >= 1
    found = findings(url)
    assert any(says in line for line in found), found
    assert not any(line.startswith("location 'empty'") for line in found)


def test_a_key_that_two_observations_have_is_named(url: str) -> None:
    with behind_its_back(url) as connection:
        connection.execute(text("DROP INDEX ix_observation_idempotency"))
        connection.execute(text("UPDATE observation SET idempotency_key = 'a' WHERE idempotency_key = 'b'"))
    assert findings(url) == ["location 'lab', idempotency key 'a': 2 observations have it"]


def flipped(blob: bytes) -> bytes:
    """One bit of a blob turned."""
    return blob[:-1] + bytes([blob[-1] ^ 1])


def test_every_blob_is_looked_at(url: str) -> None:
    """One bit in every blob: as many findings as there are blobs."""
    with behind_its_back(url) as connection:
        for table, column in (
            ("observation", "payload"),
            ("history", "payload"),
            ("spectrum", "payload"),
            ("anomaly", "cells"),
        ):
            query = f"SELECT DISTINCT {column} FROM {table} WHERE {column} IS NOT NULL"
            for blob in connection.execute(text(query)).scalars().all():
                change = text(f"UPDATE {table} SET {column} = :new WHERE {column} = :old")
                connection.execute(change, {"new": flipped(bytes(blob)), "old": blob})
    tally = LogTotals(locations=3, blobs=8, observations=5)
    found: list[Finding] = []
    assert verify(url, found.append) == tally
    assert [finding.what for finding in found if finding.what == "its checksum is wrong"] == [
        "its checksum is wrong"
    ] * 8


def planted(url: str, table: str, where: str, payload: bytes) -> list[str]:
    with behind_its_back(url) as connection:
        column = "cells" if table == "anomaly" else "payload"
        changed = connection.execute(text(f"UPDATE {table} SET {column} = :new WHERE {where}"), {"new": payload})
        assert changed.rowcount == 1
    return findings(url)


@pytest.mark.parametrize(
    ("table", "where", "payload", "says"),
    [
        ("observation", "id = 4", pack_measurements(measurements_of([(360.0, 1600, 1)])), "cell 1600 is outside"),
        (
            "observation",
            "id = 4",
            pack_measurements(measurements_of([(361.0, 7, 1)])),
            "its times are not those of its row",
        ),
        ("observation", "id = 4", pack_cells(np.arange(3)), "it is of another kind"),
        ("history", "chunk = 1", pack_segment(Segment.empty(1024, 0)), "it holds 1024 cells, the chunk has 576"),
        (
            "spectrum",
            "chunk = 1",
            pack_spectrum(static(np.zeros(9, np.float32), TimeBase(0.0, 60.0))),
            "it has 9 cells, the chunk has 576",
        ),
        ("anomaly", "id = 1", pack_cells(np.array([1600])), "its cells are not among the location's 1600"),
        ("anomaly", "id = 1", b"\7" + pack_cells(np.array([1]))[1:], "its format is 7, this version reads 1"),
    ],
)
def test_contents_that_do_not_fit_their_row_are_named(
    url: str, table: str, where: str, payload: bytes, says: str
) -> None:
    assert any(says in line for line in planted(url, table, where, payload))


def test_a_segment_that_names_what_it_lacks_is_named(ctx: Context, url: str) -> None:
    with ctx.store.read() as work:
        ((_, segment),) = work.segments.of_chunk(find_location(ctx, "lab"), 1, 0, 0)
    columns = unseal(pack_segment(segment), "history")
    spoilt = seal({**columns, "state": columns["state"][:0]})
    assert zlib.crc32(spoilt[5:]) == int.from_bytes(spoilt[1:5], "little")
    assert any("its contents do not fit: index 0 is" in line for line in planted(url, "history", "chunk = 1", spoilt))


def test_what_runs_beside_a_server_sees_no_half_of_a_write(ctx: Context, url: str) -> None:
    """An update that was broken off leaves chunks of a revision that nobody sees: that is in order."""
    location = find_location(ctx, "lab")
    ctx.store.write(
        lambda work: work.spectra.put_chunk(location.id, 5, 0, static(np.zeros(1024, np.float32), TimeBase(0.0, 60.0)))
    )
    assert findings(url) == []


def test_another_schema_is_refused(url: str) -> None:
    with behind_its_back(url) as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(SchemaVersionError, match="9999"):
        findings(url)


def test_a_database_without_a_schema_is_refused(empty_database_url: str) -> None:
    with pytest.raises((SchemaVersionError, DatabaseUnusableError)):
        findings(empty_database_url)
