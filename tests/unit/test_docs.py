"""The documentation is held to the project: links, targets, commands, settings and paths."""

import argparse
import re
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.support.commands import refusal
from tests.support.documents import anchors, blocks, code_lines, links, name, pages, spans
from tests.support.paths import ROOT
from tidemap.cli import parser
from tidemap.demo.locations import FORMS
from tidemap.settings import Settings

EVERY_PAGE = pytest.mark.parametrize("page", pages(), ids=name)
# Pages may link to these hosts and no others.
HOSTS = {"127.0.0.1", "keepachangelog.com", "semver.org", "viser.studio"}
UNFINISHED = re.compile(r"\b(TODO|FIXME|TBD|XXX)\b|lorem ipsum|(?<![\w.])/(home|root|work|Users)/", re.IGNORECASE)


@EVERY_PAGE
def test_links_lead_somewhere(page: Path) -> None:
    for link in links(page):
        parts = urlsplit(link)
        if parts.scheme:
            assert parts.hostname in HOSTS, link
            continue
        target = (page.parent / parts.path).resolve() if parts.path else page
        assert target.is_relative_to(ROOT), link
        assert target.exists(), link
        if parts.fragment:
            assert parts.fragment in anchors(target), link


@EVERY_PAGE
def test_make_targets_exist(page: Path) -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for line in code_lines(page):
        if named := re.match(r"make ([a-z]+)", line):
            assert named[1] in targets, line


@EVERY_PAGE
def test_commands_and_their_options_exist(page: Path) -> None:
    for line in code_lines(page):
        if line.startswith("tidemap "):
            assert not refusal(parser(), line.split()[1:]), line


@EVERY_PAGE
def test_settings_exist(page: Path) -> None:
    for variable in re.findall(r"\bTIDEMAP_([A-Z_]+)\b", page.read_text()):
        assert variable.lower() in Settings.model_fields, variable


@EVERY_PAGE
def test_paths_exist(page: Path) -> None:
    for span in spans(page):
        if re.fullmatch(r"(app|web|tests|docs|docker|alembic)/[\w./-]*", span):
            path = ROOT / span
            # A clone has no empty folders.
            assert path.is_file() or any(path.glob("*.*")), span


@EVERY_PAGE
def test_modules_exist(page: Path) -> None:
    for span in spans(page):
        if re.fullmatch(r"(tidemap|tidemap_web)(\.[a-z_]+)+", span) and not span.endswith(".db"):
            source = "web" if span.startswith("tidemap_web") else "app"
            path = ROOT / source / span.replace(".", "/")
            assert path.is_dir() or path.with_suffix(".py").is_file(), span


@EVERY_PAGE
def test_nothing_is_unfinished(page: Path) -> None:
    text = page.read_text()
    assert not UNFINISHED.search(text), UNFINISHED.search(text)


def test_every_page_of_docs_can_be_reached_from_the_readme() -> None:
    reached, waiting = set(), [ROOT / "README.md"]
    while waiting:
        page = waiting.pop()
        if page in reached or page.suffix != ".md" or not page.exists():
            continue
        reached.add(page)
        waiting += [(page.parent / urlsplit(link).path).resolve() for link in links(page) if not urlsplit(link).scheme]
    assert set(pages()) <= reached


def test_the_readme_shows_the_quickstart() -> None:
    example = (ROOT / "docs" / "examples" / "quickstart.py").read_text()
    shown = example.split("# [quickstart]\n")[1].split("# [/quickstart]")[0].strip()
    assert [block.strip() for block in blocks(ROOT / "README.md", "python")] == [shown]


def test_the_examples_of_the_readme_work_beside_the_demo() -> None:
    made = re.findall(r"(?:create_location\(|\"name\": )\"([^\"]+)", (ROOT / "README.md").read_text())
    assert len(made) == 2
    assert not set(made) & FORMS.keys()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("serve --port 0", ""),
        ("serve --prot 0", "no option --prot"),
        ("sevre", "no command sevre"),
        ("keys creat", "no command creat"),
        ("keys create --role robot", ""),
    ],
)
def test_refusals_are_noticed(words: str, expected: str) -> None:
    tree = argparse.ArgumentParser()
    commands = tree.add_subparsers()
    commands.add_parser("serve").add_argument("--port")
    commands.add_parser("keys").add_subparsers().add_parser("create").add_argument("--role")
    assert refusal(tree, words.split()) == expected
