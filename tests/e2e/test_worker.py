"""`tidemap worker`: the background work in a process that serves nothing."""

import subprocess
import sys
from pathlib import Path

from tests.support.contexts import make_location, opened, post_states
from tests.support.paths import ROOT
from tests.support.server import clean_environment
from tests.support.waiting import until
from tidemap.services.jobs import get_job, request_update
from tidemap.services.update import UpdateRequest


def test_a_worker_runs_the_jobs_that_wait(database_url: str, tmp_path: Path) -> None:
    with opened(database_url) as ctx, (tmp_path / "worker.log").open("w") as log:
        make_location(ctx, "door")
        post_states(ctx, "door", [60.0 * minute for minute in range(200)], [minute % 2 for minute in range(200)])
        job = request_update(ctx, "door", UpdateRequest(estimator="static"))
        words = [sys.executable, "-m", "tidemap.cli", "worker", "--database-url", database_url]
        worker = subprocess.Popen(words, cwd=ROOT, env=clean_environment(), stdout=log, stderr=log)
        try:
            until(lambda: get_job(ctx, job.id).state == "done" or worker.poll() is not None)
            assert get_job(ctx, job.id).state == "done", (tmp_path / "worker.log").read_text()
            worker.terminate()
            assert worker.wait(60) == 0
        finally:
            worker.kill()
            worker.wait()
