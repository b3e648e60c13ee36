"""Tables: CSV with a time and a state in each row."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tidemap.formats import csv
from tidemap.importing.files import content_of
from tidemap.importing.options import ImportOptions
from tidemap.importing.records import Record, StateReadings, states

SUFFIXES = {".csv", ".tsv"}


@dataclass(frozen=True)
class Table:
    """The readings of a CSV file."""

    path: Path
    options: ImportOptions
    what: str = "CSV"
    kind: Literal["state"] = "state"

    def records(self) -> Iterator[Record]:
        """All of them at once. Raises UnreadableBodyError."""
        options = self.options
        columns = csv.read(content_of(self.path), [options.time_column, options.state_column])
        state = states([self._state(*each) for each in enumerate(columns[options.state_column], 1)])
        yield StateReadings(csv.times(columns[options.time_column]) + options.start, state)

    def _state(self, row: int, text: str) -> float:
        try:
            return self.options.state_of(text)
        except ValueError as error:
            raise csv.unreadable(f"row {row}: {error}") from None
