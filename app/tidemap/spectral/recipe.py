"""Recipe: everything that decides how a spectrum is fitted, as one value that can be stored as JSON."""

import math
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, Self

Week = Literal["day", "weekend", "week", "days"]
Detail = Literal["smooth", "sharp"]

ORDER: Final = 16
"""Waves kept per cell where nothing else is asked for; on real rhythms more change p(t) by less than 0.1 %."""


@dataclass(frozen=True, slots=True)
class Prior:
    """What `calendar` believes before it sees anything: see `waves.penalties`.

    week: every day alike, weekends different, weekdays a little or much different. detail: how fast
    the day's waves die out with frequency. evidence: what one visit to a quarter of an hour counts,
    less than 1 as neighbouring samples repeat each other. half_life_days of the weight of a day,
    infinite where all count alike. weight: the share in an average of several.
    """

    week: Week = "weekend"
    detail: Detail = "smooth"
    evidence: float = 0.25
    half_life_days: float = 28.0
    weight: float = 1.0

    def __post_init__(self) -> None:
        if not (0 < self.evidence < math.inf and self.half_life_days > 0 and 0 < self.weight < math.inf):
            raise ValueError(f"evidence, half-life and weight are positive, not {self}")


PRIORS: Final = (Prior(), Prior(week="week"))
"""What is averaged where no history has decided: weekends, and a little of every weekday."""

STORED_NAMES: Final = {"carry_over": "follow", "level_sd": "doubt"}
"""Fields that are stored under a name of an earlier version."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """Estimator and order; time_zone (IANA) and all below are for `calendar`.

    calendar: an ISO 3166 code (`GB`, `GB-ENG`); its public holidays count as Sundays.

    The logits of several priors are averaged. period_s: a period that is no part of a week, in
    seconds. carry_over: the share of the last day's departure from the rhythm that is kept for what
    comes; level_sd: how far, on the logit scale, a week may be off where one was seen: see `level`.
    ValueError on a negative order.
    """

    estimator: str
    order: int = ORDER
    time_zone: str = "UTC"
    priors: tuple[Prior, ...] = PRIORS
    period_s: float | None = None
    carry_over: float = 0.0
    level_sd: float = 0.0
    calendar: str | None = None

    def __post_init__(self) -> None:
        if self.order < 0:
            raise ValueError(f"order must not be negative: {self.order}")
        if not self.priors:
            raise ValueError("a recipe needs a prior")

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; an infinite half-life is None.

        >>> Recipe.from_dict(Recipe("calendar", 8, "Europe/London").as_dict()).time_zone
        'Europe/London'
        """
        plain = {STORED_NAMES.get(name, name): value for name, value in asdict(self).items()}
        for prior in plain["priors"]:
            prior["half_life_days"] = _finite(prior["half_life_days"])
        return plain

    @classmethod
    def from_dict(cls, plain: dict[str, Any]) -> Self:
        """What `as_dict` gave, also after JSON."""
        priors = tuple(
            Prior(**{**each, "half_life_days": each["half_life_days"] or math.inf}) for each in plain["priors"]
        )
        names = {stored: name for name, stored in STORED_NAMES.items()}
        return cls(**{names.get(name, name): value for name, value in {**plain, "priors": priors}.items()})


def _finite(days: float) -> float | None:
    return None if math.isinf(days) else days
