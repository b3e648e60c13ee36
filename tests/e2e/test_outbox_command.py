"""`tidemap outbox`: what a server refused is listed, sent again, moved to a renamed location, and dropped."""

import json
from pathlib import Path

import pytest

from tests.support.here import command
from tests.support.server import ServerProcess
from tidemap import Client


@pytest.fixture
def refused(shared_server: ServerProcess, tmp_path: Path) -> Path:
    """An outbox with one reading for each of three locations that are not there."""
    file = tmp_path / "outbox.db"
    with Client(shared_server.url, outbox=file) as robot:
        for name in ("gone-1", "gone-2", "gone-3"):
            robot.location(name).observe(60.0, 1)
        assert robot.outbox.flush(60)
        assert len(robot.outbox.refused()) == 3
    return file


def listed(file: Path) -> dict[int, str]:
    """The refused batches: location by id."""
    done = command("outbox", "list", "--json", str(file))
    assert done.returncode == 0, done.stderr
    return {each["id"]: each["path"].rsplit("/", 1)[1] for each in json.loads(done.stdout)["refused"]}


def test_a_refused_batch_is_moved_retried_or_dropped(shared_server: ServerProcess, refused: Path) -> None:
    moved, retried, dropped = listed(refused)
    with Client(shared_server.url) as operator:
        there = operator.create_location("there-now", interval_s=60)
        late = operator.create_location("gone-2", interval_s=60)
        for words in (("move", "there-now", str(moved)), ("retry", str(retried)), ("drop", str(dropped))):
            action, *rest = words
            done = command("outbox", action, str(refused), *rest)
            assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
        assert listed(refused) == {}
        assert "0 refused, 2 waiting" in command("outbox", "list", str(refused)).stdout
        with Client(shared_server.url, outbox=refused) as robot:
            assert robot.outbox.flush(60)
            assert robot.outbox.refused() == []
        assert (there.get().observations, late.get().observations) == (1, 1)
        late.delete()
        there.delete()


def test_the_list_says_why(refused: Path) -> None:
    done = command("outbox", "list", str(refused))
    assert "gone-1\t1 measurements\t" in done.stdout
    assert "(404)" in done.stdout
    assert "3 refused, 0 waiting" in done.stdout


def test_a_file_that_is_no_outbox(tmp_path: Path) -> None:
    done = command("outbox", "list", str(tmp_path / "typo.db"))
    assert (done.returncode, done.stdout) == (1, "")
    assert "there is no such file" in done.stderr
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "letter.db").write_text("a letter" * 1000)
    assert "no outbox" in command("outbox", "list", str(tmp_path / "letter.db")).stderr


def test_a_batch_that_is_not_refused(refused: Path) -> None:
    done = command("outbox", "drop", str(refused), "999")
    assert done.returncode == 1
    assert "999" in done.stderr
