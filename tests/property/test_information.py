"""Information: never negative, at most ln 2, none of what is certain; and it is the sum over outcomes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tidemap.spectral.conditioning import Persistence
from tidemap.spectral.information import EXACT, ErrorRates, best_times, entropy_nats, information

P = st.floats(0, 1)
LOOKS = st.tuples(P, P).filter(lambda each: sum(each) < 1).map(lambda each: ErrorRates(*each))


@given(p=st.lists(P, min_size=1), look=LOOKS)
def test_information_is_between_nothing_and_the_entropy(p: list[float], look: ErrorRates) -> None:
    for precision in (np.float32, np.float64):
        probability = np.array(p, precision)
        said, unknown = information(probability, look), entropy_nats(probability)
        assert (said >= 0).all()
        assert (said <= unknown + 1e-12).all()
        assert (unknown <= math.log(2)).all()


@given(p=P, look=LOOKS)
def test_it_is_the_expected_divergence_of_what_is_believed_after_the_look(p: float, look: ErrorRates) -> None:
    """Σ P(seen) · KL(P(state | seen) ‖ P(state)), Bayes by hand."""
    expected = 0.0
    for occupied, free in ((1 - look.miss, look.false_alarm), (look.miss, 1 - look.false_alarm)):
        seen = p * occupied + (1 - p) * free
        for own, likely in ((p, occupied), (1 - p, free)):
            if own > 0 and likely > 0:
                expected += own * likely * (math.log(likely) - math.log(seen))
    assert information(p, look) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("look", [EXACT, ErrorRates(0.1, 0.2), ErrorRates(0.0, 0.4)])
def test_a_certain_state_has_none(look: ErrorRates) -> None:
    assert information([0.0, 1.0], look).tolist() == pytest.approx([0, 0], abs=1e-15)
    assert np.isnan(information([np.nan], look)).all()
    assert entropy_nats([0.0, 1.0, 0.5]).tolist() == pytest.approx([0, 0, math.log(2)])


@pytest.mark.parametrize("wrong", [(0.5, 0.5), (-0.1, 0.0), (0.0, 1.1), (math.nan, 0.0)])
def test_looks_that_say_nothing_or_the_contrary_are_refused(wrong: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="below 1"):
        ErrorRates(*wrong)


VALUES = st.lists(st.floats(0, 1), max_size=30)


@given(value=VALUES, n=st.integers(0, 8), apart_s=st.floats(0, 10))
def test_the_best_times_are_apart_and_nothing_better_was_free(value: list[float], n: int, apart_s: float) -> None:
    time, values = np.arange(len(value), dtype=float), np.array(value)
    best = best_times(time, values, n, apart_s)
    assert len(best) <= n
    assert len(set(best.tolist())) == len(best)
    for k, row in enumerate(best):
        free = [i for i in range(len(value)) if all(abs(i - j) >= apart_s and i != j for j in best[:k])]
        assert values[row] == max(values[free])
        assert row == min(i for i in free if values[i] == values[row])
    if len(best) < n:
        assert all(any(abs(i - j) < apart_s or i == j for j in best) for i in range(len(value)))


@given(
    nu=st.floats(0.1, 0.99),
    tau_s=st.floats(1, 1e5),
    alpha=st.floats(0.1, 5),
    kappa=st.floats(0, 2),
    age=st.floats(0, 1e5),
)
def test_at_its_half_life_half_of_a_reading_is_left(
    nu: float, tau_s: float, alpha: float, kappa: float, age: float
) -> None:
    persistence = Persistence(nu, tau_s, alpha, kappa)
    now, then = persistence.kept(1, [0.0, persistence.half_life_s(age)], age)
    assert then == pytest.approx(now / 2)
