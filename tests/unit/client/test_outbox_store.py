"""The file of the outbox against a list in memory, and what happens when the file or the disk is bad."""

import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from tests.support.paths import ROOT
from tidemap.client import OutboxError, OutboxFullError, Pending
from tidemap.client.outbox.file import prepare
from tidemap.client.outbox.store import PAGE_BYTES, OutboxStore
from tidemap.client.posting import Batch

MOST = 60
LOCATIONS = ("/locations/a", "/locations/b")


def batch(path: str = LOCATIONS[0], content: bytes = b"x", key: str = "k") -> Batch:
    return Batch(path, {"source": "spot"}, "text/plain", content, key, 3)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """An outbox with nothing in it."""
    prepare(tmp_path / "outbox.db")
    return tmp_path / "outbox.db"


@pytest.fixture
def store(path: Path) -> Iterator[OutboxStore]:
    with closing(OutboxStore(path, durable=True)) as opened:
        yield opened


@dataclass
class Row:
    """What the model knows of a batch."""

    batch: Batch
    tries: int = 0
    status: int | None = None
    error: str | None = None
    id: int = field(default=0)


class OutboxModel(RuleBasedStateMachine):
    """Puts, sends, failures, refusals, decisions and restarts in any order; the model is a list."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="outbox-model-"))
        self.path = self.folder / "outbox.db"
        prepare(self.path)
        self.store = OutboxStore(self.path, durable=True)
        self.rows: list[Row] = []
        self.made = 0
        self.crashes = 0

    def waiting(self, but: str | None = None) -> list[Row]:
        return [row for row in self.rows if row.status is None and row.batch.path != but]

    def put_aside(self) -> list[Row]:
        return [row for row in self.rows if row.status is not None]

    @rule(posts=st.lists(st.tuples(st.sampled_from(LOCATIONS), st.binary(max_size=20)), max_size=4))
    def put(self, posts: list[tuple[str, bytes]]) -> None:
        new = [batch(path, content, f"{self.made + i}") for i, (path, content) in enumerate(posts)]
        self.made += len(new)
        held = sum(len(row.batch.content) for row in self.rows)
        if held + sum(len(each.content) for each in new) > MOST:
            with pytest.raises(OutboxFullError, match=f"holds {held}"):
                self.store.put(new, MOST)
            return
        queued = self.store.put(new, MOST)
        assert (queued.batches, queued.measurements) == (len(new), 3 * len(new))
        self.rows += [Row(each) for each in new]

    @rule()
    def put_what_cannot_be_made(self) -> None:
        """Nothing of it is kept."""

        def broken() -> Iterator[Batch]:
            yield batch(content=b"")
            raise ValueError("no such state")

        with pytest.raises(ValueError, match="no such state"):
            self.store.put(broken(), MOST)

    @precondition(lambda self: self.waiting())
    @rule(fate=st.sampled_from(["sent", "failed", "refused"]), but=st.sampled_from([None, *LOCATIONS]))
    def send_the_first(self, fate: str, but: str | None) -> None:
        kept = self.store.first([] if but is None else [but])
        expected = self.waiting(but)
        assert (kept and kept.batch) == (expected[0].batch if expected else None)
        if kept is None:
            return
        assert not kept.damaged
        row = expected[0]
        if fate == "sent":
            self.store.sent(kept.id)
            self.rows.remove(row)
        elif fate == "failed":
            self.store.failed(kept.id, "busy")
            row.tries, row.error = row.tries + 1, "busy"
        else:
            self.store.refuse(kept.id, 422, "wrong")
            row.tries, row.status, row.error = row.tries + 1, 422, "wrong"

    @precondition(lambda self: self.put_aside())
    @rule(data=st.data(), again=st.booleans())
    def decide(self, data: st.DataObject, again: bool) -> None:
        which = data.draw(st.integers(0, len(self.put_aside()) - 1))
        row, number = self.put_aside()[which], self.store.refused()[which].id
        if again:
            self.store.retry(number)
            row.status = None
        else:
            self.store.discard(number)
            self.rows.remove(row)
        with pytest.raises(OutboxError, match="no refused batch"):
            self.store.discard(number)

    @rule()
    def reopen(self) -> None:
        self.store.close()
        prepare(self.path)
        self.store = OutboxStore(self.path, durable=True)

    @rule()
    def crash(self) -> None:
        """The files as they lie there now, with a log that nobody has tidied up."""
        self.crashes += 1
        copy = self.folder / f"crashed-{self.crashes}.db"
        for suffix in ("", "-wal"):
            shutil.copyfile(f"{self.path}{suffix}", f"{copy}{suffix}")
        self.store.close()
        self.path = copy
        self.store = OutboxStore(copy, durable=True)

    @rule()
    def shrink(self) -> None:
        self.store.shrink()

    @invariant()
    def agree(self) -> None:
        waiting = self.waiting()
        pending = self.store.pending()
        assert (pending.batches, pending.bytes) == (len(waiting), sum(len(row.batch.content) for row in waiting))
        assert pending.last_error == (waiting[0].error if waiting else None)
        shown = [(each.key, each.path, each.tries, each.status, each.error) for each in self.store.refused()]
        assert shown == [(r.batch.key, r.batch.path, r.tries, r.status, r.error) for r in self.put_aside()]

    def teardown(self) -> None:
        for row in self.waiting():
            kept = self.store.first()
            assert kept is not None
            assert kept.batch == row.batch
            self.store.sent(kept.id)
        assert self.store.pending() == Pending(0, 0)
        self.store.close()
        shutil.rmtree(self.folder)


OutboxModel.TestCase.settings = settings(max_examples=30, stateful_step_count=30)
TestOutboxModel = OutboxModel.TestCase


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"a robot's diary\n", "no outbox but another file"),
        (b"SQLite format 3\0" + bytes(4096), "no outbox but another file|damaged"),
    ],
)
def test_another_file_is_left_alone(tmp_path: Path, content: bytes, words: str) -> None:
    file = tmp_path / "diary.txt"
    file.write_bytes(content)
    with pytest.raises(OutboxError, match=words) as caught:
        prepare(file)
    assert str(file) in str(caught.value)
    assert file.read_bytes() == content


def test_another_database_is_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "other.db"
    with closing(sqlite3.connect(file)) as db:
        db.execute("CREATE TABLE batch (id INTEGER)")
    before = file.read_bytes()
    with pytest.raises(OutboxError, match="another program's database"):
        prepare(file)
    assert file.read_bytes() == before


def test_the_form_of_another_version_is_refused(path: Path) -> None:
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA user_version = 9")
    with pytest.raises(OutboxError, match="form 9"):
        prepare(path)


def test_a_folder_that_does_not_exist_is_said(tmp_path: Path) -> None:
    with pytest.raises(OutboxError, match="folder exists"):
        prepare(tmp_path / "nowhere" / "outbox.db")


def test_a_name_is_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in (":memory:", "50%20?mode=memory", "#1"):
        prepare(Path(name))
        with closing(OutboxStore(Path(name), durable=True)) as store:
            store.put([batch()], MOST)
        assert (tmp_path / name).stat().st_size > 0


def test_a_damaged_file_is_noticed_when_it_is_opened(path: Path, store: OutboxStore) -> None:
    store.put([batch(content=bytes(2000)) for _ in range(50)], 1 << 20)
    store.close()
    with path.open("r+b") as file:
        file.seek(5 * 4096)
        file.write(b"\xff" * 3 * 4096)
    with pytest.raises(OutboxError, match="damaged"):
        prepare(path)


@pytest.fixture(scope="module")
def torn_off(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[int]]:
    """An outbox as a crash leaves it, with a log of several posts, and where in the log each of them ends."""
    path = tmp_path_factory.mktemp("torn") / "outbox.db"
    prepare(path)
    log, ends = Path(f"{path}-wal"), []
    with closing(OutboxStore(path, durable=True)) as store:
        for number in range(6):
            store.put([batch(content=bytes([number]) * 3000), batch(key=f"{number}")], 1 << 20)
            ends.append(log.stat().st_size)
        for file in (path, log):
            shutil.copyfile(file, file.with_name(file.name.replace("outbox", "crashed")))
    return path.with_name("crashed.db"), ends


@given(data=st.data())
def test_a_log_torn_off_keeps_every_post_that_was_whole(torn_off: tuple[Path, list[int]], data: st.DataObject) -> None:
    """As by a power cut before a post had reached the disk; what comes behind the tear may be anything."""
    crashed, ends = torn_off
    whole = Path(f"{crashed}-wal").read_bytes()
    tear = data.draw(st.integers(0, len(whole)) | st.sampled_from(ends))
    rubbish = data.draw(st.sampled_from([b"", bytes(5000), bytes(range(256)) * 40]))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "outbox.db"
        shutil.copyfile(crashed, path)
        Path(f"{path}-wal").write_bytes(whole[:tear] + rubbish)
        prepare(path)
        with closing(OutboxStore(path, durable=True)) as store:
            posts = sum(end <= tear for end in ends)
            assert store.pending().batches == 2 * posts
            store.put([batch(key="later")], 1 << 20)
            for number in range(posts):
                for expected in (batch(content=bytes([number]) * 3000), batch(key=f"{number}")):
                    kept = store.first()
                    assert kept is not None
                    assert (kept.batch, kept.damaged) == (expected, False)
                    store.sent(kept.id)
            last = store.first()
            assert last is not None
            assert last.batch.key == "later"


def test_a_row_that_is_not_the_one_in_the_index_is_found_when_the_file_is_opened(path: Path) -> None:
    """Taking it out of the file would fail: nothing behind it would ever be sent."""
    with closing(OutboxStore(path, durable=True)) as store:
        store.put([batch(content=b"1" * 3000, key=str(number)) for number in range(20)], 1 << 20)
    content = path.read_bytes()
    at = content.rindex(LOCATIONS[0].encode())
    path.write_bytes(content[:at] + b"\0" + content[at + 1 :])
    with pytest.raises(OutboxError, match="damaged"):
        prepare(path)


@given(data=st.data())
def test_nothing_in_a_file_cut_short_is_taken_for_what_was_observed(data: st.DataObject) -> None:
    written = [batch(content=bytes([number]) * 3000) for number in range(1, 21)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "outbox.db"
        prepare(path)
        with closing(OutboxStore(path, durable=True)) as store:
            store.put(written, 1 << 20)
        size = path.stat().st_size
        left = data.draw(st.integers(100, size - 1) | st.integers(size - PAGE_BYTES, size - 1))
        with path.open("r+b") as file:
            file.truncate(left)
        try:
            prepare(path)
        except OutboxError:
            return
        # Only the end of the last page is gone.
        assert size - left < PAGE_BYTES
        with closing(OutboxStore(path, durable=True)) as store:
            for expected in written:
                kept = store.first()
                assert kept is not None
                assert kept.damaged or kept.batch == expected
                store.sent(kept.id)


def test_a_batch_whose_query_cannot_be_read_is_damaged(store: OutboxStore, path: Path) -> None:
    store.put([batch()], MOST)
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        for text in ("\0\0", "3", ""):
            db.execute("UPDATE batch SET query = ?", [text])
            kept = store.first()
            assert kept is not None
            assert kept.damaged


def test_a_changed_content_is_not_taken_for_what_was_observed(store: OutboxStore, path: Path) -> None:
    store.put([batch(content=b"101")], MOST)
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute("UPDATE batch SET content = ?", [b"111"])
    kept = store.first()
    assert kept is not None
    assert kept.damaged


def test_a_full_disk_is_said_and_nothing_half_kept(store: OutboxStore) -> None:
    pages = store._db.execute("PRAGMA page_count").fetchone()[0]
    store._db.execute(f"PRAGMA max_page_count = {pages + 8}")
    store.put([batch(content=bytes(8000))], 1 << 20)
    with pytest.raises(OutboxError, match="the disk is full") as caught:
        store.put([batch(content=bytes(8000)) for _ in range(20)], 1 << 20)
    assert not isinstance(caught.value, OutboxFullError)
    assert store.pending().batches == 1
    store._db.execute(f"PRAGMA max_page_count = {pages + 1000}")
    store.put([batch(content=bytes(8000)) for _ in range(20)], 1 << 20)
    assert store.pending().batches == 21


def test_a_disk_is_not_filled_so_far_that_nothing_can_be_taken_out(
    store: OutboxStore, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of what the disk has is for the log to be brought into the file."""
    disk = 8 << 20

    def usage(folder: Path) -> SimpleNamespace:
        return SimpleNamespace(free=disk - sum(file.stat().st_size for file in folder.iterdir()))

    monkeypatch.setattr("tidemap.client.outbox.store.shutil.disk_usage", usage)
    fill = [batch(content=bytes(200_000))]
    with suppress(OutboxError):
        for _ in range(100):
            store.put(fill, 1 << 30)
    with pytest.raises(OutboxError, match="bytes must be free"):
        store.put(fill, 1 << 30)
    assert store.pending().batches >= 10
    log = Path(f"{path}-wal").stat().st_size
    assert usage(path.parent).free >= log


def test_a_disk_that_takes_no_more_in_the_midst_of_a_put(path: Path) -> None:
    code = f"""
import resource
from pathlib import Path
from tidemap.client import OutboxError
from tidemap.client.outbox.store import PAGE_BYTES, OutboxStore
from tests.unit.client.test_outbox_store import batch
store = OutboxStore(Path({str(path)!r}), durable=True)
store.put([batch(content=bytes(100_000))], 1 << 30)
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
try:
    store.put([batch(content=bytes(100_000)) for _ in range(5)], 1 << 30)
except OutboxError as error:
    print(error)
print(store.pending().batches)
"""
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    said, left = run.stdout.splitlines()
    assert "disk" in said
    assert left == "1"
    prepare(path)
    with closing(OutboxStore(path, durable=True)) as store:
        assert store.pending().batches == 1
        store.put([batch(content=bytes(100_000)) for _ in range(5)], 1 << 30)


def test_an_outbox_that_was_full_gives_the_disk_back(store: OutboxStore, path: Path) -> None:
    store.put([batch(content=bytes(1 << 20)) for _ in range(12)], 1 << 30)
    while (kept := store.first()) is not None:
        store.shrink()
        store.sent(kept.id)
    store.shrink()
    store.close()
    assert path.stat().st_size < 100_000


def test_processes_that_open_a_new_outbox_at_once_make_one(tmp_path: Path) -> None:
    code = f"""
from pathlib import Path
from tidemap.client.outbox.file import prepare
from tidemap.client.outbox.store import PAGE_BYTES, OutboxStore
from tests.unit.client.test_outbox_store import batch
path = Path({str(tmp_path / "outbox.db")!r})
input()
prepare(path)
store = OutboxStore(path, durable=True)
for _ in range(20):
    store.put([batch(), batch()], 1 << 20)
"""
    command = [sys.executable, "-c", code]
    started = [subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, text=True) for _ in range(4)]
    for process in started:
        process.communicate("go\n", timeout=60)
    assert [process.returncode for process in started] == [0, 0, 0, 0]
    with closing(OutboxStore(tmp_path / "outbox.db", durable=True)) as store:
        assert store.pending().batches == 160
