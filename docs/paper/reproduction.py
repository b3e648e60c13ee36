"""The paper's own experiment: one week of an office door, its accuracies by order, its outliers."""

from itertools import pairwise
from pathlib import Path

from docs.paper import office_figures, recordings
from docs.paper.document import table
from docs.paper.orders import Row, accuracies

NEEDS = recordings.OFFICE
HEADER = ("order", "reconstruction", "day_1", "day_2", "outlier intervals")


def make(images: Path) -> dict[str, str]:
    """Figures 1, 4, 5 and 6 and the table of orders 0 to 20."""
    office = recordings.office()
    rows = accuracies(office)
    office_figures.model(office, images / "figure-1.png")
    office_figures.forecast(office, images / "figure-4.png")
    office_figures.orders(rows, images / "figure-5.png")
    anomalies = office_figures.anomalies(office, images / "figure-6.png")
    body = table(HEADER, (row.cells() for row in rows))
    return {"reproduction": body, "claims": claims(rows), "office_anomalies": anomalies}


def claims(rows: list[Row]) -> str:
    """What the paper says of this recording, and what comes out."""
    up_to_5 = rows[1:6]
    best = [max(up_to_5, key=lambda row: getattr(row, day)).order for day in ("day_1", "day_2")]
    at_15 = rows[15]
    falls = [a.reconstruction - b.reconstruction for a, b in pairwise(rows) if b.reconstruction < a.reconstruction]
    return table(
        ("the paper says", "here"),
        [
            ("95 % of the week is reconstructed at order 15", f"{100 * at_15.reconstruction:.1f} %"),
            ("prediction has local maxima at orders 2 and 3", f"at order {best[0]} on day_1 and {best[1]} on day_2"),
            ("accuracy of prediction is about 90 %", _span([rows[2], rows[3]])),
            (
                "reconstruction grows monotonically with the order",
                f"{len(falls)} of {len(rows) - 1} steps lead down, by {100 * max(falls):.1f} percentage points at most",
            ),
            ("O has 160 limits at order 15", f"{2 * at_15.intervals} limits, of {at_15.intervals} intervals"),
        ],
    )


def _span(rows: list[Row]) -> str:
    shares = [share for row in rows for share in (row.day_1, row.day_2)]
    return f"{100 * min(shares):.0f} to {100 * max(shares):.0f} % at orders 2 and 3"
