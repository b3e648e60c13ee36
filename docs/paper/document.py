"""The document: blocks of Markdown between marker comments, and the tables in them."""

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from tests.support.paths import ROOT

PAGE = ROOT / "docs" / "method.md"
IMAGES = ROOT / "docs" / "images" / "paper"
_BLOCK = re.compile(
    r"^<!-- begin (\w+): `make paper` writes this -->\n(.*?)^<!-- end \1 -->$", re.MULTILINE | re.DOTALL
)


def blocks(text: str) -> dict[str, str]:
    """Every block of a document by its name; ValueError where one is there twice or its markers do not match."""
    found = _BLOCK.findall(text)
    names = re.findall(r"^<!-- (?:begin|end) (\w+)", text, re.MULTILINE)
    if names != [name for name, _ in found for _ in range(2)] or len(names) != 2 * len(set(names)):
        raise ValueError(f"markers do not match: {' '.join(names)}")
    return dict(found)


def filled(text: str, parts: dict[str, str]) -> str:
    """A document with some of its blocks replaced; ValueError where one has no markers.

    >>> page = "<!-- begin a: `make paper` writes this -->\\n1\\n<!-- end a -->"
    >>> blocks(filled(page, {"a": "2"}))
    {'a': '2\\n'}
    """
    if unknown := parts.keys() - blocks(text).keys():
        raise ValueError(f"no markers for {', '.join(sorted(unknown))}")

    def block(match: re.Match[str]) -> str:
        if match[1] not in parts:
            return match[0]
        first, *_, last = match[0].splitlines()
        return f"{first}\n{parts[match[1]].strip()}\n{last}"

    return _BLOCK.sub(block, text)


def write(page: Path, parts: dict[str, str]) -> None:
    """Replace blocks of a page on disk."""
    page.write_text(filled(page.read_text(), parts))


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table, numbers to the right; ValueError where a row has another length than the header.

    >>> print(table(["order", "error"], [["1", ".25"]]))
    | order | error |
    | --- | ---: |
    | 1 | .25 |
    """
    every = [list(row) for row in rows]
    if any(len(row) != len(header) for row in every):
        raise ValueError("a row differs in length from the header")
    ruler = ["---"] + ["---:" if all(_is_number(row[i]) for row in every) else "---" for i in range(1, len(header))]
    return "\n".join(f"| {' | '.join(row)} |" for row in [list(header), ruler, *every])


def parse(text: str) -> list[dict[str, str]]:
    """The rows of the first table of a text by the names of its columns, emphasis left out."""
    lines = re.findall(r"^\| (.*) \|$", text, re.MULTILINE)
    header, _, *rows = [line.replace("**", "").split(" | ") for line in lines]
    return [dict(zip(header, row, strict=True)) for row in rows]


def number(value: float, decimals: int = 3) -> str:
    """A share or a score as papers print it.

    >>> number(0.0512), number(1.5, 2), number(float("nan"))
    ('.051', '1.50', '–')
    """
    if math.isnan(value):
        return "–"
    return f"{value:.{decimals}f}".removeprefix("0")


def _is_number(cell: str) -> bool:
    return bool(re.fullmatch(r"(\*\*)?[−–\d.,]+(\*\*)?", cell))
