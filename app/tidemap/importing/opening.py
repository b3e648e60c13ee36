"""Opening: which kind of file is which. One line adds a kind."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tidemap.errors import UnusableFileError
from tidemap.importing.files import naming, suffix_of
from tidemap.importing.options import ImportOptions
from tidemap.importing.records import ImportSource
from tidemap.importing.sources.bags import is_bag, open_bag
from tidemap.importing.sources.clouds import CloudFolder, clouds_of
from tidemap.importing.sources.logs import SUFFIXES as LOG_SUFFIXES
from tidemap.importing.sources.logs import Log
from tidemap.importing.sources.maps import MAP_SUFFIXES, TREE_SUFFIXES, FloorMap, Tree
from tidemap.importing.sources.tables import SUFFIXES as TABLE_SUFFIXES
from tidemap.importing.sources.tables import Table


@dataclass(frozen=True, slots=True)
class FileKind:
    """What a kind of file is called, which files are of it, and how they are opened."""

    name: str
    matches: Callable[[Path], bool]
    open: Callable[[Path, ImportOptions], Sequence[ImportSource]]


def _ends(suffixes: set[str]) -> Callable[[Path], bool]:
    return lambda path: path.is_file() and suffix_of(path) in suffixes


KINDS = (
    FileKind("bags (.bag, .db3, .mcap, folders with metadata.yaml)", is_bag, open_bag),
    FileKind(
        "folders of clouds (.pcd, .ply)",
        lambda path: path.is_dir() and bool(clouds_of(path)),
        lambda path, options: [CloudFolder(path, options)],
    ),
    FileKind("tables (.csv, .tsv)", _ends(TABLE_SUFFIXES), lambda path, options: [Table(path, options)]),
    FileKind("CARMEN logs (.log, .clf)", _ends(LOG_SUFFIXES), lambda path, options: [Log(path, options)]),
    FileKind("maps of map_server (.yaml, .zip)", _ends(MAP_SUFFIXES), lambda path, options: [FloorMap(path, options)]),
    FileKind("OctoMap (.bt, .ot)", _ends(TREE_SUFFIXES), lambda path, options: [Tree(path, options)]),
)


def open_files(paths: Iterable[Path], options: ImportOptions) -> list[ImportSource]:
    """What there is to import. Raises UnusableFileError."""
    found: list[ImportSource] = []
    for path in paths:
        if not path.exists():
            raise UnusableFileError(path, "There is no such file. Check its name.")
        kind = next((each for each in KINDS if each.matches(path)), None)
        if kind is None:
            known = "; ".join(each.name for each in KINDS)
            raise UnusableFileError(path, f"It is of no kind that is read: {known}. Rename or convert it.")
        with naming(path):
            found += kind.open(path, options)
    return found
