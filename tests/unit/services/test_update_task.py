"""An update's task is plain data: another process runs it and stores the same bytes."""

import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import create_engine, select

from tests.support.contexts import Clock, Serial, make_location, opened, post_rows
from tidemap.errors import CorruptChunkError, NotLeaderError
from tidemap.services.context import Context
from tidemap.services.locations import find_location
from tidemap.services.update import UpdateRequest, run_update
from tidemap.services.update_task import run_task
from tidemap.storage.tables import spectrum

ELSEWHERE = """
import pickle, sys
from pathlib import Path
from tidemap.services.context import open_context
from tidemap.services.update_task import run_task
from tidemap.settings import Settings

with open_context(Settings(database_url=sys.argv[1])) as ctx:
    task = pickle.loads(Path(sys.argv[2]).read_bytes())
    Path(sys.argv[3]).write_bytes(pickle.dumps(run_task(ctx, task)))
"""


class Keeping(Serial):
    """Keeps the tasks that it runs, and what they give."""

    def map(self, run: Any, items: Any) -> Any:
        self.tasks = list(items)
        self.results = list(super().map(run, self.tasks))
        return self.results


def updated(ctx: Context) -> Keeping:
    make_location(ctx, "lab", (80, 40))
    post_rows(ctx, "lab", [(60.0 * n, cell, n % 3 == 0) for n in range(200) for cell in (7, 1500, 3000)])
    executor = Keeping(ctx)
    run_update(ctx, find_location(ctx, "lab").id, UpdateRequest(estimator="fft", order=2), executor, lambda _: None)
    return executor


def stored(url: str) -> list[tuple[Any, ...]]:
    engine = create_engine(url)
    with engine.connect() as connection:
        rows = [tuple(row) for row in connection.execute(select(spectrum)).all()]
    engine.dispose()
    return sorted(rows, key=lambda row: row[:3])


def test_a_pickled_task_gives_the_same_stored_bytes_in_a_fresh_process(
    database_url: str, clock: Clock, tmp_path: Path
) -> None:
    with opened(database_url, clock) as ctx:
        executor = updated(ctx)
        before = stored(database_url)
        assert len(before) == len(executor.tasks) > 1
        ctx.store.write(lambda work: work.spectra._connection.execute(spectrum.delete()))
    assert stored(database_url) == []
    for task, result in zip(executor.tasks, executor.results, strict=True):
        given, told = tmp_path / "task", tmp_path / "result"
        given.write_bytes(pickle.dumps(task))
        assert given.stat().st_size < 2000
        subprocess.run([sys.executable, "-c", ELSEWHERE, database_url, str(given), str(told)], check=True)
        assert pickle.loads(told.read_bytes()) == result
    assert stored(database_url) == before


def test_a_task_of_a_term_that_is_over_stores_nothing(ctx: Context) -> None:
    task = replace(updated(ctx).tasks[0], term=ctx.store.write(lambda work: work.terms.begin()))
    ctx.store.write(lambda work: work.spectra._connection.execute(spectrum.delete()))
    ctx.store.write(lambda work: work.terms.begin())
    with pytest.raises(NotLeaderError):
        run_task(ctx, task)
    assert stored(ctx.settings.url) == []


def test_the_error_of_a_damaged_chunk_survives_pickling() -> None:
    error = pickle.loads(pickle.dumps(CorruptChunkError("segment 3", "its checksum is wrong")))
    assert (error.what, error.why) == ("segment 3", "its checksum is wrong")
    assert str(error) == str(CorruptChunkError("segment 3", "its checksum is wrong"))
