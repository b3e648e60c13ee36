"""One thing, one word: code, pages and documentation keep to the vocabulary of docs/conventions.md."""

import ast
import io
import re
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.documents import blocks, name, pages, spans
from tests.support.paths import ROOT

# What is not said, and what is said instead.
WORDS = {
    "place places": "location",
    "voxel voxels": "cell",
    "datapoint datapoints": "measurement",
    "retrain retrains retrained": "update",
    "patience insist insists": "RetryPolicy, retry, max_wait_s",
    "duty": "LeaderTerm, LeaderElection",
    "loan loans lender lend lends lent lendable borrow borrows": "BufferLease, BufferPool, lease",
    "sheet sheets": "ArrowBuffer, StateBuffer, buffer",
    "wish wishes": "EventFilter, PendingGrant, ViewRequest, request",
    "tell tells told telling": "publish, report",
    "look looks": "snapshot, observation",
    "turn turns turned": "phasor, unit_phasors, complex_product",
    "greatest": "top_k, highest",
    "spread spreads": "fill_unobserved",
    "ascent ascend ascends": "logistic, maximise",
    "follow follows": "carry_over, live",
    "doubt doubts": "level_sd",
    "unmade": "submit_deferred",
    "trouble troubles": "OutageTracker, is_outage, outage",
    "fate fates": "SendOutcome",
}
NAMES = {
    "order_look": "sort_snapshot",
    "of_connection": "authenticate",
    "sending": "require_sender",
    "Turn": "SenderLock",
    "Rest": "Backoff",
    "Rests": "Backoff",
    "Terms": "FencingTokens",
    "give_back": "tune_malloc",
    "give_back_freed": "tune_malloc",
    "giving_back": "periodic_trim",
}
PHRASES = re.compile(r"\b(of which|whoever|what is more|the mend)\b", re.IGNORECASE)
# Only of prose: libraries have a `timestamp`.
PROSE = re.compile(r"\b(voxels?|timestamps?|datapoints?|retrain\w*)\b", re.IGNORECASE)
INSTEAD = {word: instead for words, instead in WORDS.items() for word in words.split()}
# Where a library calls it so: a file tells its position, a camera looks at something.
ELSEWHERE = {
    "app/tidemap/formats/npy.py": {"tell"},
    "web/tidemap_web/viewer/layout.py": {"look_at"},
    "web/tidemap_web/viewer/scene.py": {"look_at"},
}
# Verbs of two words.
VERBS = re.compile(r"_?(look_up)")
# Words for observed and occupied where both are at hand; counts are `n_observed` and `n_occupied`.
PAIR = {"seen", "full"}
CORE = {"history", "spectral", "calendar", "auto"}

SOURCES = sorted(path for folder in ("app", "web", "alembic", "docs") for path in (ROOT / folder).rglob("*.py"))
STATIC = ROOT / "web" / "tidemap_web" / "pages"
SCRIPTS = sorted(path for path in (STATIC / "static").rglob("*.js") if "vendor" not in path.parts)
TEMPLATES = sorted((STATIC / "templates").glob("*.html"))
# The list of changes says what was called otherwise before.
PAGES = [page for page in pages() if page.name != "CHANGELOG.md"]
_QUOTED = re.compile(r"//[^\n]*|\"[^\"\n]*\"|'[^'\n]*'")
_MARKUP = re.compile(r"\{\{(.*?)\}\}|\{%(.*?)%\}|(?:id|class|for|data-\w+)=\"([^\"]*)\"", re.DOTALL)


def identifiers(path: Path) -> set[str]:
    """The names that code, or the code on a page, is written in."""
    text = path.read_text()
    match path.suffix:
        case ".py":
            tokens = tokenize.generate_tokens(io.StringIO(text).readline)
            return {token.string for token in tokens if token.type == tokenize.NAME}
        case ".js":
            return named(_QUOTED.sub("", text))
        case ".html":
            return named(" ".join("".join(found) for found in _MARKUP.findall(text)))
        case _:
            return named("\n".join([*spans(path), *blocks(path, "python"), *blocks(path, "json")]))


def named(code: str) -> set[str]:
    return set(re.findall(r"[A-Za-z_]\w*", code))


def words(identifier: str) -> list[str]:
    """The words of a name: `StateBuffer` and `state_buffer` are of two."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", identifier).lower().split("_")


def synonyms(found: set[str]) -> Iterator[str]:
    """What of these names the vocabulary has another word for."""
    for identifier in sorted(found):
        if identifier.lstrip("_") in NAMES:
            yield f"{identifier}: say {NAMES[identifier.lstrip('_')]}"
        for word in [] if VERBS.fullmatch(identifier) else words(identifier):
            if word in INSTEAD:
                yield f"{identifier}: say {INSTEAD[word]}"


@pytest.mark.parametrize("path", [path for path in SOURCES if path.parent.name in CORE], ids=name)
def test_what_is_observed_and_what_is_occupied_is_called_so(path: Path) -> None:
    names = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Name)]
    assert not {node.id for node in names if isinstance(node.ctx, ast.Store)} >= PAIR


def flat(path: Path) -> str:
    """A text as if it had no lines and no signs of comments."""
    return re.sub(r"\s+(?:#|//|\*)?\s*", " ", path.read_text())


@pytest.mark.parametrize("path", [*SOURCES, *SCRIPTS, *TEMPLATES, *PAGES], ids=name)
def test_one_word_per_thing(path: Path) -> None:
    found = identifiers(path) - ELSEWHERE.get(name(path), set())
    assert not list(synonyms(found))


@pytest.mark.parametrize("path", [*SOURCES, *SCRIPTS, *TEMPLATES, *pages()], ids=name)
def test_plain_english(path: Path) -> None:
    text = flat(path)
    assert not PHRASES.search(text), PHRASES.search(text)


@pytest.mark.parametrize("page", pages(), ids=name)
def test_one_word_per_thing_in_prose(page: Path) -> None:
    prose = re.sub(r"`[^`\n]*`", "", page.read_text())
    assert not PROSE.search(prose), PROSE.search(prose)


def test_no_class_name_stands_twice() -> None:
    ours = [path for path in SOURCES if path.is_relative_to(ROOT / "app") or path.is_relative_to(ROOT / "web")]
    trees = [ast.parse(path.read_text()) for path in ours]
    classes = Counter(node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    assert len(classes) > 200
    assert [each for each, times in classes.items() if times > 1] == []


def test_all_kinds_of_files_are_read() -> None:
    assert len(SOURCES) > 150
    assert {"viewer.js", "location.js"} <= {path.name for path in SCRIPTS}
    assert {"viewer.html", "location.html"} <= {path.name for path in TEMPLATES}
    assert "location" in identifiers(STATIC / "templates" / "location.html")
    assert "subscribers" in identifiers(STATIC / "static" / "core" / "state.js")
    assert "interval_s" in identifiers(ROOT / "README.md")


@pytest.mark.parametrize(
    ("suffix", "text", "expected"),
    [
        (".py", "class MapSheet:\n    pass  # a sheet\n", ["MapSheet: say ArrowBuffer, StateBuffer, buffer"]),
        (".py", "placeholder = 'place'\nin_place = 1\n", ["in_place: say location"]),
        (".py", "def _giving_back() -> None: ...\n", ["_giving_back: say periodic_trim"]),
        (".py", "class Returns: ...\nreturned = look_up(1)\n", []),
        (".py", "turn = look(1)\n", ["look: say snapshot, observation", "turn: say " + INSTEAD["turn"]]),
        (".py", "out_look = 1\n", ["out_look: say snapshot, observation"]),
        (".js", "let wish = null; // a wish\nsay('a wish', \"a wish\");", ["wish: say " + INSTEAD["wish"]]),
        (".html", '<p id="places">A place for {{ name }}</p>', ["places: say location"]),
        (".md", "Its place is `placed.at(x)`, or\n```python\nfor place in all: ...\n```\n", ["place: say location"]),
    ],
)
def test_synonyms_are_noticed(tmp_path: Path, suffix: str, text: str, expected: list[str]) -> None:
    path = tmp_path / f"text{suffix}"
    path.write_text(text)
    assert list(synonyms(identifiers(path))) == expected


def test_phrases_are_noticed_across_lines(tmp_path: Path) -> None:
    path = tmp_path / "text.py"
    path.write_text("# Three files, two of\n    # which are old.\n")
    assert PHRASES.search(flat(path))
