"""What a list shows: search, order and page, read from an address and written into others. Nothing of it can be wrong:
what is not known is left out."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args
from urllib.parse import urlencode

from tidemap.storage.repositories.locations import LocationFilter

PAGE = 50
MAX_SEARCH = 128
MAX_PAGE = 1_000_000
Sort = Literal["name", "seen", "anomalies"]
SORTS: tuple[Sort, ...] = get_args(Sort)
DAYS = (1, 7, 30)
States = Literal["open", "acknowledged", "all"]
STATES: tuple[States, ...] = get_args(States)
ACKNOWLEDGED: Mapping[States, bool | None] = {"open": False, "acknowledged": True, "all": None}
SURPRISES = (0.0, 0.9, 0.95, 0.99)


@dataclass(frozen=True, slots=True)
class LocationList:
    """Which of the locations are listed; pages count from 1."""

    q: str = ""
    alarmed: bool = False
    sort: Sort = "name"
    descending: bool = False
    page: int = 1

    @classmethod
    def read(cls, query: Mapping[str, str]) -> "LocationList":
        """From the query of an address.

        >>> LocationList.read({"q": " lab ", "sort": "seen", "order": "down", "page": "x"})
        LocationList(q='lab', alarmed=False, sort='seen', descending=True, page=1)
        """
        sort: Sort = next((each for each in SORTS if each == query.get("sort")), "name")
        number = _whole(query.get("page"))
        return cls(
            _search(query),
            query.get("alarmed") == "yes",
            sort,
            query.get("order") == "down",
            max(1, min(number or 1, MAX_PAGE)),
        )

    @property
    def filter(self) -> LocationFilter:
        """As the database is asked."""
        return LocationFilter(self.q, self.alarmed, self.sort, self.descending)

    @property
    def offset(self) -> int:
        """How many come before this page."""
        return (self.page - 1) * PAGE

    def sorted_by(self, sort: Sort) -> str:
        """The query of this list in another order; the other way round where it has that order."""
        usual = sort != "name"
        return replace(self, sort=sort, descending=not self.descending if sort == self.sort else usual, page=1).query()

    def on(self, page: int) -> str:
        """The query of another page."""
        return replace(self, page=page).query()

    def query(self) -> str:
        """For an address; what is as usual is left out.

        >>> LocationList(q="a b", descending=True).query(), LocationList().query()
        ('?q=a+b&order=down', '?')
        """
        said = {"q": self.q, "alarmed": "yes" if self.alarmed else "", "sort": self.sort if self.sort != "name" else ""}
        return _query(said | {"order": "down" if self.descending else "", "page": self.page if self.page > 1 else ""})


@dataclass(frozen=True, slots=True)
class AnomalyList:
    """Which of the anomalies are listed: of the location `of`, or of those whose names contain `q`; of the last days,
    before an id."""

    of: str | None = None
    q: str = ""
    state: States = "open"
    days: int | None = None
    surprise: float = 0.0
    before: int | None = None

    @classmethod
    def read(cls, query: Mapping[str, str]) -> "AnomalyList":
        """From the query of an address.

        >>> AnomalyList.read({"q": "lab", "state": "all", "days": "7", "surprise": "0.95", "before": "12"})
        AnomalyList(of=None, q='lab', state='all', days=7, surprise=0.95, before=12)
        >>> AnomalyList.read({"of": "lab", "state": "x", "days": "8", "surprise": "nan", "before": "-3"})
        AnomalyList(of='lab', q='', state='open', days=None, surprise=0.0, before=None)
        """
        state: States = next((each for each in STATES if each == query.get("state")), "open")
        return cls(
            query.get("of") or None,
            _search(query),
            state,
            next((each for each in DAYS if str(each) == query.get("days")), None),
            next((each for each in SURPRISES if str(each) == query.get("surprise")), 0.0),
            _whole(query.get("before")),
        )

    @property
    def acknowledged(self) -> bool | None:
        """As the database is asked."""
        return ACKNOWLEDGED[self.state]

    def older(self, before: int) -> str:
        """The query of the page with those before an id."""
        return replace(self, before=before).query()

    def query(self) -> str:
        """For an address."""
        said = {"of": self.of or "", "q": self.q, "state": self.state if self.state != "open" else ""}
        return _query(said | {"days": self.days or "", "surprise": self.surprise or "", "before": self.before or ""})


def _search(query: Mapping[str, str]) -> str:
    """What names have to contain; no name has a NUL, which PostgreSQL refuses to look for.

    >>> _search({"q": " la\\0b "}), _search({})
    ('lab', '')
    """
    return query.get("q", "").replace("\0", "").strip()[:MAX_SEARCH]


def _query(values: Mapping[str, Any]) -> str:
    return "?" + urlencode({name: value for name, value in values.items() if value != ""})


def _whole(text: str | None) -> int | None:
    """A positive whole number as a database holds it, None where it is none."""
    return int(text) if text is not None and text.isascii() and text.isdecimal() and len(text) <= 18 else None
