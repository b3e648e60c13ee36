"""Ascent: penalised logistic regressions of many cells on one design, by preconditioned conjugate gradients.

Each step costs two matrix products, shared by a block of cells, and takes the Newton length along its
direction, and needs no factorisation.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from tidemap.history.jit import fused_kernel
from tidemap.spectral.calendar.products import Matrix, Panels, pack, product

ROWS = 64
"""Rows fitted at once, so that what they need stays in the processor's cache."""
STEPS = 40
TOLERANCE = 0.01
"""A row is done when its log posterior is within about half of this, in nats, of its maximum."""
OVERSHOT = -0.5
MANY_RUNNING = 0.9
"""Share of the rows, up to which those that run go on alone."""

Vector = NDArray[np.float32]
Flags = NDArray[np.bool_]


def fit_rows(
    design: Matrix,
    n_observed: Matrix,
    n_occupied: Matrix,
    evidence: Vector,
    penalty: Vector,
    kept: Matrix | None = None,
    start: Matrix | None = None,
) -> Matrix:
    """Coefficients (n_rows, n_columns) of greatest posterior, the centre of the intercept included.

    design (n_slots, n_columns), the first column ones; n_observed, n_occupied (n_rows, n_slots): visits, and those
    occupied; evidence (n_rows,) multiplies both; penalty (n_columns,): infinite leaves a column out.
    kept (n_rows, n_columns): 0 leaves a column out of a row. start: where to begin, it changes the
    cost alone. The intercept is drawn to `base_logit`.
    """
    used = np.flatnonzero(np.isfinite(penalty))
    columns = np.ascontiguousarray(design[:, used])
    plan = (pack(columns), pack(columns.T), np.asarray(np.mean(columns * columns, axis=0), np.float32))
    centre = base_logit(n_observed, n_occupied)
    begin = np.zeros((n_observed.shape[0], used.size), np.float32) if start is None else start[:, used]
    allowed = np.ones_like(begin) if kept is None else kept[:, used]
    out = np.zeros((n_observed.shape[0], design.shape[1]), np.float32)
    for first in range(0, n_observed.shape[0], ROWS):
        rows = slice(first, first + ROWS)
        one = evidence[rows, np.newaxis]
        at = begin[rows].copy()
        if start is not None:
            at[:, 0] -= centre[rows]
        parts = (
            n_observed[rows] * one,
            n_occupied[rows] * one,
            allowed[rows],
            centre[rows, np.newaxis],
            at * allowed[rows],
        )
        out[rows, used] = _maximise(*plan, penalty[used], *parts)
    return out


def evaluate(design: Matrix, beta: Matrix) -> Matrix:
    """The logits (…, n_slots) of coefficients (…, n_columns)."""
    rows = product(beta.reshape(-1, beta.shape[-1]), pack(design.T))
    return rows.reshape(*beta.shape[:-1], design.shape[0])


def base_logit(n_observed: Matrix, n_occupied: Matrix) -> Vector:
    """The logit of the share of visits that were occupied, half a visit of each kind added, (n_rows,)."""
    observed, occupied = n_observed.sum(axis=1), n_occupied.sum(axis=1)
    return np.asarray(np.log((occupied + 0.5) / (observed - occupied + 0.5)), np.float32)


def _dot(a: Matrix, b: Matrix) -> Vector:
    return np.asarray(np.einsum("ij,ij->i", a, b), np.float32)


@dataclass(slots=True, eq=False)
class _Rows:
    """Rows on their way, (n,) or (n, …) each: which of the block they are, what they are fitted to, where they are, and
    the direction of the step before with its gradient and its gain."""

    row: NDArray[np.int64]
    n_observed: Matrix
    n_occupied: Matrix
    scale: Matrix
    beta: Matrix
    eta: Matrix
    residual: Matrix
    curvature: Matrix
    step: Matrix
    gradient: Matrix
    gain: Vector

    def keep(self, which: Flags) -> None:
        """Go on with some of them."""
        for each in fields(self):
            setattr(self, each.name, getattr(self, each.name)[which])


def _maximise(
    design: Panels,
    transposed: Panels,
    square: Vector,
    penalty: Vector,
    n_observed: Matrix,
    n_occupied: Matrix,
    kept: Matrix,
    centre: Matrix,
    beta: Matrix,
) -> Matrix:
    """One block from `beta` on: Polak–Ribière directions, each row on its own until it is done. Rows that are done stay
    where they are, and are put aside when they are many."""
    share = 1 / (1 + np.exp(-centre))
    level = n_observed.sum(axis=1, keepdims=True) * share * (1 - share)
    scale = kept / np.maximum(penalty + level * square, np.float32(1e-6))
    eta = centre + product(beta, transposed)
    still, ones = np.zeros_like(beta), np.ones(len(beta), np.float32)
    sides = response(eta, n_observed, n_occupied)
    on = _Rows(np.arange(len(beta)), n_observed, n_occupied, scale, beta, eta, *sides, still, still, ones)
    out = beta.copy()
    for _ in range(STEPS):
        gradient = product(on.residual, design) - penalty * on.beta
        ahead = on.scale * gradient
        gain = _dot(gradient, ahead)
        running = gain > TOLERANCE
        if not running.any():
            break
        if running.sum() <= MANY_RUNNING * len(running):
            out[on.row] = on.beta
            on.keep(running)
            gradient, ahead, gain, running = gradient[running], ahead[running], gain[running], running[running]
        _climb(on, transposed, penalty, gradient, ahead, gain, running)
    out[on.row] = on.beta
    out[:, :1] += centre
    return out


def _climb(
    on: _Rows, transposed: Panels, penalty: Vector, gradient: Matrix, ahead: Matrix, gain: Vector, running: Flags
) -> None:
    """One step of the rows that run, in place: along a direction conjugate to the one before, as far as Newton's step
    or, where that is too far, less."""
    keep = np.maximum(0, (gain - _dot(on.gradient, ahead)) / on.gain)
    step = ahead + keep[:, np.newaxis] * on.step
    wrong = _dot(gradient, step) <= 0
    step[wrong] = ahead[wrong]
    on.step, on.gradient, on.gain = step, gradient, np.maximum(gain, np.float32(1e-20))
    move = product(step, transposed)
    slope, weighed = _dot(gradient, step), penalty * step
    bend = _dot(on.curvature, move * move) + _dot(weighed, step)
    length = np.where(running, slope / np.maximum(bend, np.float32(1e-20)), 0).astype(np.float32)
    pull, stiff = _dot(weighed, on.beta), _dot(weighed, step)
    for _ in range(6):
        eta = on.eta + length[:, np.newaxis] * move
        on.residual, on.curvature = response(eta, on.n_observed, on.n_occupied)
        left = _dot(on.residual, move) - pull - length * stiff
        over = running & (left < OVERSHOT * slope)
        if not over.any():
            break
        shorter = length * slope / np.where(over, slope - left, 1)
        length = np.where(over, shorter, length).astype(np.float32)
    on.beta, on.eta = on.beta + length[:, np.newaxis] * step, eta


def response(eta: Matrix, n_observed: Matrix, n_occupied: Matrix) -> tuple[Matrix, Matrix]:
    """n_occupied - n_observed · p and n_observed · p (1 - p)."""
    residual, curvature = np.empty_like(eta), np.empty_like(eta)
    _respond(eta.ravel(), n_observed.ravel(), n_occupied.ravel(), residual.ravel(), curvature.ravel())
    return residual, curvature


@fused_kernel
def _respond(eta: Vector, n_observed: Vector, n_occupied: Vector, residual: Vector, curvature: Vector) -> None:
    """p = ½ + ½ tanh(½ η), tanh as a ratio of polynomials: exact to 2e-7, and vectorised where exp is not.

    The minimax coefficients of degree 13 over 6 are those widely used for float32 (as in Eigen).
    """
    for i in range(eta.size):
        x = np.float32(0.5) * min(max(eta[i], np.float32(-15.8)), np.float32(15.8))
        y = x * x
        top = y * np.float32(-2.76076847742355e-16) + np.float32(2.00018790482477e-13)
        top = y * top + np.float32(-8.60467152213735e-11)
        top = y * top + np.float32(5.12229709037114e-08)
        top = y * top + np.float32(1.48572235717979e-05)
        top = y * top + np.float32(6.37261928875436e-04)
        top = x * (y * top + np.float32(4.89352455891786e-03))
        below = y * np.float32(1.19825839466702e-06) + np.float32(1.18534705686654e-04)
        below = y * below + np.float32(2.26843463243900e-03)
        below = y * below + np.float32(4.89352518554385e-03)
        p = np.float32(0.5) + np.float32(0.5) * (top / below)
        expected = n_observed[i] * p
        residual[i] = n_occupied[i] - expected
        curvature[i] = expected - expected * p
