"""Conditioning: the state at a time, given the latest reading of a cell (DESIGN 2.8).

Read backwards from t: with probability r nothing was redrawn since the latest reading s0 at t0, so s(t) = s0;
otherwise s0 came from the rhythm at t0. Bayes gives odds(t | s0 = 1) = odds p(t) · (1 + g) and
odds(t | s0 = 0) = odds p(t) / (1 + g) with g = r / ((1 - r) · q), where q is p(t0) if s0 = 1, else 1 - p(t0).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.history import UNOBSERVED
from tidemap.history.jit import kernel
from tidemap.spectral.correction import NO_CORRECTION, LastingCorrection, correction_at

MAX_KEPT: Final = 0.9995
"""The most that r may be: no reading is certain for ever."""
MAX_LASTED: Final = MAX_KEPT / (1 - MAX_KEPT)
"""The same of r / (1 - r)."""
MIN_PROBABILITY: Final = 1e-4
"""The least that the rhythm may believe of a state that was read, and of one that is asked for."""


@dataclass(frozen=True, slots=True)
class Persistence:
    """How long states last: r(δ, a) = ν ((τ + κa) / (τ + κa + δ))^α, a mixture of exponentials, and a correction.

    nu: the share of readings that are no flicker, in (0, 1); tau_s in seconds; alpha, kappa: without unit. A state that
    has lasted long lasts longer by κ times that. correction: what is added to ln(r / (1 - r)), after which r is
    `MAX_KEPT` at most. ValueError where one of them is out of range.
    """

    nu: float = float(1 / (1 + np.exp(-2.0)))
    tau_s: float = 1800.0
    alpha: float = 1.0
    kappa: float = float(np.exp(-2.0))
    correction: LastingCorrection = NO_CORRECTION

    def __post_init__(self) -> None:
        if not (0 < self.nu < 1 and self.tau_s > 0 and self.alpha > 0 and self.kappa >= 0):
            raise ValueError(f"nu lies between 0 and 1, the others are positive, not {self}")

    def kept(self, state: ArrayLike, delta_s: ArrayLike, age_s: ArrayLike) -> NDArray[np.float64]:
        """r: the probability that nothing was redrawn for `delta_s` seconds after a state had lasted `age_s`.

        >>> Persistence(nu=0.5, tau_s=60.0, alpha=1.0, kappa=0.0).kept(1, [0.0, 60.0, 180.0], 5.0).round(4).tolist()
        [0.5, 0.25, 0.125]
        """
        scale = self.tau_s + self.kappa * np.asarray(age_s, np.float64)
        r = self.nu * (scale / (scale + np.asarray(delta_s, np.float64))) ** self.alpha
        lasted = r / (1 - r) * np.exp(self.correction.at(state, delta_s, age_s))
        return np.asarray(np.minimum(MAX_KEPT, lasted / (1 + lasted)))

    def half_life_s(self, age_s: float) -> float:
        """How long until half of what a reading says of later states is gone, after a state had lasted `age_s`.

        Without the correction.

        >>> Persistence(nu=0.5, tau_s=60.0, alpha=1.0, kappa=0.0).half_life_s(5.0)
        60.0
        """
        return float((self.tau_s + self.kappa * age_s) * np.expm1(np.log(2) / self.alpha))

    def as_dict(self) -> dict[str, Any]:
        """As plain JSON."""
        plain: dict[str, Any] = {"nu": self.nu, "tau_s": self.tau_s, "alpha": self.alpha, "kappa": self.kappa}
        if self.correction is not NO_CORRECTION:
            plain["correction"] = [self.correction.interval_s, self.correction.value.tolist()]
        return plain

    @classmethod
    def from_dict(cls, value: Mapping[str, Any]) -> "Persistence":
        """The inverse of `as_dict`. ValueError, TypeError or KeyError where it is none."""
        formula = {name: value[name] for name in ("nu", "tau_s", "alpha", "kappa")}
        if "correction" not in value:
            return cls(**formula)
        interval_s, table = value["correction"]
        return cls(**formula, correction=LastingCorrection(interval_s, np.array(table, np.float64)))


UNLEARNED: Final = Persistence()
"""What is believed without having learned."""


@dataclass(frozen=True, slots=True)
class Standing:
    """How readings stand: for `hold` samples after their own, but not after sample `limit`."""

    hold: int = 0
    limit: int = 0


EVIDENCE_BYTES: Final = 17
"""Of each cell."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The latest reading of some cells, (n,) each; `EVIDENCE_BYTES` a cell.

    state: uint8, UNOBSERVED where there is none. sample: int64. age: uint32, how many samples it had lasted, its own
    included. q: float32, the model's probability of it when it was read.
    """

    state: NDArray[np.uint8]
    sample: NDArray[np.int64]
    age: NDArray[np.uint32]
    q: NDArray[np.float32]

    @property
    def nbytes(self) -> int:
        """The memory it takes."""
        return sum(each.nbytes for each in self._columns())

    def rows(self, rows: NDArray[np.int64]) -> "Evidence":
        """That of some rows, in any order; a copy."""
        return Evidence(self.state[rows], self.sample[rows], self.age[rows], self.q[rows])

    def replaced(self, rows: NDArray[np.int64], other: "Evidence") -> "Evidence":
        """A copy with that of `other` in some rows."""
        copy = Evidence(self.state.copy(), self.sample.copy(), self.age.copy(), self.q.copy())
        for mine, new in zip(copy._columns(), other._columns(), strict=True):
            mine[rows] = new
        return copy

    def _columns(self) -> tuple[NDArray[np.generic], ...]:
        return self.state, self.sample, self.age, self.q

    def condition(
        self,
        p: NDArray[np.float32],
        sample: NDArray[np.int64],
        interval_s: float,
        persistence: Persistence,
        standing: Standing = Standing(),
    ) -> NDArray[np.float32]:
        """p (n, m) of these cells in samples (m,), given the readings of the same sample or earlier ones."""
        out = np.empty(p.shape[::-1], np.float32)
        learned = (persistence.nu, persistence.tau_s, persistence.alpha, persistence.kappa)
        scale = (interval_s, standing.hold, standing.limit)
        read = (self.state, self.sample, self.age, self.q)
        correction = persistence.correction.value
        _condition(np.ascontiguousarray(p.T), *read, np.ascontiguousarray(sample), scale, learned, correction, out)
        return out.T


def condition(p: ArrayLike, q: ArrayLike, state: ArrayLike, kept: ArrayLike) -> NDArray[np.float64]:
    """p(t) given the latest reading, of the shape of the arguments together; without exp and log.

    p: the model's p(t); q: the model's probability of what was read, when it was read; state: 0 or 1; kept: r. r = 0
    gives p, r = 1 the reading.

    >>> condition([0.5, 0.5, 0.02], [0.5, 0.5, 0.02], [1, 0, 1], [0.5, 0.5, 0.5]).round(3).tolist()
    [0.75, 0.25, 0.51]
    """
    bounded = np.clip(np.asarray(p, np.float64), MIN_PROBABILITY, 1 - MIN_PROBABILITY)
    likely = np.maximum(np.asarray(q, np.float64), MIN_PROBABILITY)
    r = np.asarray(kept, np.float64)
    lasted = r / (1 - r)
    occupied = np.asarray(state) != 0
    own = np.where(occupied, bounded, 1 - bounded)
    given = own * (likely + lasted) / (likely + own * lasted)
    return np.asarray(np.where(occupied, given, 1 - given))


@kernel
def _condition(
    p: NDArray[np.float32],
    state: NDArray[np.uint8],
    read: NDArray[np.int64],
    age: NDArray[np.uint32],
    q: NDArray[np.float32],
    asked: NDArray[np.int64],
    scale: tuple[float, int, int],
    learned: tuple[float, float, float, float],
    correction: NDArray[np.float64],
    out: NDArray[np.float32],
) -> None:
    """out (m, n): `condition` of p (m, n). Neighbours are often read alike: what is kept of them is computed once."""
    first = 0
    while first < state.size:
        last = first + 1
        while last < state.size and read[last] == read[first] and age[last] == age[first]:
            last += 1
        for row in range(asked.size):
            if asked[row] < read[first]:
                out[row, first:last] = p[row, first:last]
            else:
                free = _lasted(0, read[first], age[first], asked[row], scale, learned, correction)
                occupied = _lasted(1, read[first], age[first], asked[row], scale, learned, correction)
                _condition_alike(p[row], state, q, first, last, free, occupied, out[row])
        first = last


@kernel
def _lasted(
    state: Any,
    read: int,
    age: int,
    asked: int,
    scale: tuple[float, int, int],
    learned: tuple[float, float, float, float],
    correction: NDArray[np.float64],
) -> float:
    """r / (1 - r) of a reading of a state in a sample that is asked for."""
    interval_s, hold, limit = scale
    nu, tau_s, alpha, kappa = learned
    until = max(read, min(read + hold, limit))
    lived, apart = age + until - read, max(0, asked - until)
    span = tau_s + kappa * lived * interval_s
    kept = nu * (span / (span + apart * interval_s)) ** alpha
    return float(min(MAX_LASTED, kept / (1 - kept) * np.exp(correction_at(correction, state, apart, lived))))


@kernel
def _condition_alike(
    p: NDArray[np.float32],
    state: NDArray[np.uint8],
    q: NDArray[np.float32],
    first: int,
    last: int,
    free: float,
    occupied: float,
    out: NDArray[np.float32],
) -> None:
    """Cells [first, last), read in the same sample after the same time; without branches, several at once.

    An index without a sign cannot count from the end: to look for that would take twice as long.
    """
    least, most = np.float32(MIN_PROBABILITY), np.float32(1 - MIN_PROBABILITY)
    one, lasted = np.float32(1), (np.float32(free), np.float32(occupied))
    for i in range(np.uint64(first), np.uint64(last)):
        bounded = least if p[i] < least else (most if p[i] > most else p[i])
        likely = least if q[i] < least else q[i]
        own, much = (bounded, lasted[1]) if state[i] == 1 else (one - bounded, lasted[0])
        given = own * (likely + much) / (likely + own * much)
        known = given if state[i] == 1 else one - given
        out[i] = p[i] if state[i] == UNOBSERVED else known
