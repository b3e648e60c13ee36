"""`tidemap export`: where the file goes."""

from argparse import Namespace
from pathlib import Path

import pytest

from tidemap.cli_files import _save
from tidemap.cli_support import DONE, FAILED
from tidemap.client import MapFile

FILE = MapFile("hall.pcd", b"points", 0.0, 1, "")


def save(output: Path, *, overwrite: bool = False) -> int:
    return _save(FILE, Namespace(output=output, overwrite=overwrite, json=False))


def test_what_is_there_is_kept_unless_it_is_to_be_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / FILE.name
    assert save(tmp_path) == DONE
    path.write_bytes(b"mine")
    assert (save(tmp_path), path.read_bytes()) == (FAILED, b"mine")
    assert "say --overwrite" in capsys.readouterr().err
    assert (save(tmp_path, overwrite=True), path.read_bytes()) == (DONE, FILE.content)


def test_a_link_to_nothing_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / FILE.name).symlink_to(tmp_path / "elsewhere")
    assert save(tmp_path / "here") == FAILED
    assert not (tmp_path / "elsewhere").exists()


def test_a_folder_that_is_not_there_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert save(tmp_path / "nowhere" / "hall.pcd") == FAILED
    assert f"{tmp_path / 'nowhere' / 'hall.pcd'} cannot be written" in capsys.readouterr().err
