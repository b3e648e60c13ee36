"""How far long work is: a bar on a terminal, plain lines elsewhere."""

import io

import pytest

from tidemap.progress import Bar, Lines, ShownProgress


class Terminal(io.StringIO):
    """A stream that claims to be a terminal."""

    def isatty(self) -> bool:
        return True


def test_progress_is_a_bar_on_a_terminal_and_lines_elsewhere() -> None:
    terminal, log = Terminal(), io.StringIO()
    for stream, shown in ((terminal, Bar), (log, Lines)):
        task = ShownProgress(stream).task("History", 4)
        assert isinstance(task, shown)
        with task as step:
            step(4)
    assert "History: 100%" in terminal.getvalue()
    assert "\r" not in log.getvalue()
    assert log.getvalue().splitlines()[0] == "History: ..."
    assert log.getvalue().splitlines()[-1].startswith("History: done after")


@pytest.mark.parametrize(("stream", "says"), [(Terminal(), "Copying: 100%"), (io.StringIO(), "Copying: 100 % of 8\n")])
def test_a_length_that_becomes_known_on_the_way(
    stream: io.StringIO, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tidemap.progress.LINE_EVERY_S", 0.0)
    with ShownProgress(stream).share("Copying") as show:
        show(2, 8)
        show(8, 8)
    assert says in stream.getvalue()


def test_lines_say_how_far_it_is_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 0.0, 1.0, 6.0, 6.0, 7.0, 8.0, 8.0])
    monkeypatch.setattr("tidemap.progress.time.monotonic", lambda: next(clock))
    log = io.StringIO()
    with Lines("History", 4, log) as step:
        step(1)
        step(1)
        step(1)
    assert log.getvalue().splitlines()[1:-1] == ["History: 50 % of 4"]


def test_a_task_that_breaks_says_so() -> None:
    log = io.StringIO()
    with pytest.raises(RuntimeError), Lines("History", 4, log):
        raise RuntimeError
    assert "History: broken off after" in log.getvalue()


def test_a_task_of_unknown_length_says_how_much_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 0.0, 6.0, 6.0, 7.0, 7.0])
    monkeypatch.setattr("tidemap.progress.time.monotonic", lambda: next(clock))
    log, terminal = io.StringIO(), Terminal()
    with Lines("Reading", 0, log) as step:
        step(3)
    assert log.getvalue().splitlines()[1:-1] == ["Reading: 3"]
    monkeypatch.undo()
    with Bar("Reading", 0, terminal) as step:
        step(3)
    assert "Reading: 3it" in terminal.getvalue()
