"""The table of settings in operations.md, written from app/tidemap/settings.py: `python -m docs.settings_table`."""

import re
from pathlib import Path
from typing import Any

from tidemap.settings import Settings

PAGE = Path(__file__).parent / "operations.md"
_TABLE = re.compile(r"(?<=<!-- begin settings -->\n).*(?=<!-- end settings -->)", re.DOTALL)


def page() -> str:
    """The page with the table as it should be."""
    return _TABLE.sub(lambda _: table(), PAGE.read_text())


def table() -> str:
    """One row a setting, in the order of the settings."""
    rows = [
        f"| `TIDEMAP_{name.upper()}` | {_shown(field.default)} | {field.description} |"
        for name, field in Settings.model_fields.items()
    ]
    return "\n".join(["| setting | default | |", "| --- | --- | --- |", *rows, ""])


def _shown(value: Any) -> str:
    """A default as one sets it."""
    if value is None or value == ():
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.12g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    PAGE.write_text(page())
