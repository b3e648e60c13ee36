"""Threads that work in the background are less urgent than those that answer."""

import os
import sys
import threading
from typing import Any

import pytest

from tidemap.workers.executors import LocalExecutor
from tidemap.workers.priority import LOWER, give_way


def urgency(*_: Any) -> int:
    return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has priorities of threads")
def test_the_threads_of_updates_give_way_and_no_other_does() -> None:
    own = urgency()
    executor: Any = LocalExecutor(None, 2)  # type: ignore[arg-type]
    try:
        assert set(executor.map(urgency, range(8))) == {min(own + LOWER, 19)}
        assert set(executor.map(lambda *_: give_way() or urgency(), range(8))) == {min(own + LOWER, 19)}, "once"
    finally:
        executor.close()
    assert urgency() == own
