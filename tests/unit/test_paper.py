"""docs/method.md: its blocks, tables and figures are those that `make paper` writes, and its numbers come out again."""

import doctest
import re
from importlib import import_module
from pathlib import Path

import pytest

from docs.paper import __main__ as paper
from docs.paper import document, recordings
from docs.paper.costs import FIGURES, row
from docs.paper.document import IMAGES, PAGE, blocks, filled, number, parse, table
from docs.paper.orders import ORDERS, accuracies
from docs.paper.reproduction import HEADER, claims
from tests.bench.timing import Figure
from tests.support.documents import links

MAX_BYTES = 150_000
BLOCKS = blocks(PAGE.read_text())
TABLES = sorted(BLOCKS.keys() - {"rooms_rivals"})
MEASURES = ("rooms_log_loss", "rooms_brier", "rooms_calibration")


@pytest.mark.parametrize("name", TABLES)
def test_tables_parse(name: str) -> None:
    rows = parse(BLOCKS[name])
    assert len(rows) >= 2
    assert all(cell for row in rows for cell in row.values())


def test_every_table_is_between_markers() -> None:
    text = PAGE.read_text()
    for body in BLOCKS.values():
        text = text.replace(body, "")
    assert not re.findall(r"^\|.*(?<!\w)\.\d{3}", text, re.MULTILINE), "a table with numbers that nobody makes"


def test_every_figure_is_made_shown_and_small() -> None:
    shown = {link for link in links(PAGE) if link.startswith("images/paper/")}
    assert shown == {f"images/paper/{path.name}" for path in IMAGES.iterdir()}
    code = "".join(path.read_text() for path in Path(paper.__file__).parent.glob("*.py"))
    for path in IMAGES.iterdir():
        assert f'"{path.name}"' in code
        assert path.stat().st_size <= MAX_BYTES, path.name


def test_figures_hold_no_time_and_no_program() -> None:
    for path in IMAGES.glob("*.png"):
        assert not re.search(rb"tEXt|iTXt|tIME", path.read_bytes()), path.name


def test_the_table_of_orders_comes_out_again() -> None:
    if absent := recordings.missing(recordings.OFFICE):
        pytest.skip(f"no real data: ../shared/data lacks {', '.join(absent)}")
    rows = accuracies(recordings.office())
    assert parse(table(HEADER, (row.cells() for row in rows))) == parse(BLOCKS["reproduction"])
    assert parse(claims(rows)) == parse(BLOCKS["claims"])


def test_the_waves_are_those_of_the_code(tmp_path: Path) -> None:
    made = import_module("docs.paper.waves").make(tmp_path)
    assert parse(made["waves"]) == parse(BLOCKS["waves"])


def test_the_document_says_what_the_paper_does() -> None:
    rows = {int(row["order"]): row for row in parse(BLOCKS["reproduction"])}
    assert list(rows) == list(ORDERS)
    assert float(rows[15]["reconstruction"]) == pytest.approx(0.95, abs=0.01)
    for day in ("day_1", "day_2"):
        assert float(rows[2][day]) > max(float(rows[1][day]), float(rows[3][day]))


def test_the_document_says_that_registration_pays() -> None:
    for line in parse(BLOCKS["lab_poses"]):
        true, registered, stated = (float(line[f"{name} poses"]) for name in ("true", "registered", "stated"))
        assert abs(true - registered) <= 0.02
        assert registered > stated
    for line in parse(BLOCKS["lab_registration"]):
        assert int(line["wrong of them"]) <= 0.01 * int(line["accepted"].replace(",", ""))


def test_the_laboratory_is_as_predictable_as_the_papers() -> None:
    rows = parse(BLOCKS["laboratory"])
    assert len(rows) == 9
    for line in rows:
        assert min(float(line["reconstruction"]), float(line["prediction, next two days"])) > 0.9


@pytest.mark.parametrize("name", MEASURES)
def test_the_means_are_those_of_the_rooms(name: str) -> None:
    *rooms, mean = parse(BLOCKS[name])
    assert len(rooms) == 9
    for column in ("auto", "fft", "by day", "by weekend", "by weekday"):
        average = sum(float(room[column]) for room in rooms) / len(rooms)
        assert float(mean[column]) == pytest.approx(average, abs=1.1e-4)


def test_parts_without_recordings_are_skipped_and_say_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(paper, "missing", lambda needs: recordings.missing(needs, tmp_path))
    monkeypatch.setattr(paper, "write", lambda *_: pytest.fail("nothing was made"))
    assert paper.main(["rooms", "clocks"]) == 0
    assert "rooms: skipped, as ../shared/data lacks aruba/rooms.csv.gz\n" in capsys.readouterr().out
    assert paper.main(["appendix"]) == 2


def test_every_part_has_its_blocks() -> None:
    code = {part: Path(str(import_module(f"docs.paper.{part}").__file__)).read_text() for part in paper.PARTS}
    for name in BLOCKS:
        assert any(f'"{name}"' in text for text in code.values()), name


def test_costs_are_rows_of_the_bench() -> None:
    assert [row["figure"] for row in parse(BLOCKS["cost"])] == list(FIGURES)
    line = Figure(2345.6, 1000.0, 3.0, "µs/cell", {"peak_mb": 44, "n": 20_000}).line()
    assert row({"figure": "update", **line})[-6:] == ["µs/cell", "2,346", "1,000", "2.346", "3", "peak mb 44, n 20,000"]


def test_blocks_are_replaced_and_nothing_else() -> None:
    page = "# A\n<!-- begin a: `make paper` writes this -->\n<!-- end a -->\ntext\n"
    once = filled(page, {"a": "| x |"})
    assert blocks(once) == {"a": "| x |\n"}
    assert filled(once, {"a": "| x |"}) == once
    assert filled(once, {"a": "| x |"}).replace("| x |\n", "") == page
    with pytest.raises(ValueError, match="no markers for b"):
        filled(page, {"b": ""})
    with pytest.raises(ValueError, match="do not match"):
        blocks(page.replace("end a", "end b"))


def test_the_examples_of_the_document_hold() -> None:
    assert doctest.testmod(document).failed == 0


def test_tables_are_written_and_read() -> None:
    cells = {"model": "auto", "error": ".051"}
    assert parse(table(list(cells), [["**auto**", "**.051**"]])) == [cells]
    with pytest.raises(ValueError, match="length"):
        table(["a"], [["1", "2"]])
    assert number(-0.1234) == "-0.123"
