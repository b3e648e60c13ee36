"""The state as it is believed after every sample, by a detector that learned from another recording."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.unit.spectral.real import Things
from tidemap.history.sequences import Sequences
from tidemap.spectral.belief import Beliefs
from tidemap.spectral.detection import ReadCells, learn_detector
from tidemap.spectral.detector import Detector
from tidemap.spectral.estimators import fit
from tidemap.spectral.evaluation import reliability
from tidemap.spectral.prediction import predict, predict_readings
from tidemap.spectral.sensor import Sensor
from tidemap.spectral.spectrum import Spectrum


@dataclass(frozen=True, slots=True)
class Scores:
    """Of probabilities against what was true."""

    mean_absolute_error: float
    accuracy: float
    brier: float
    calibration: float


@dataclass(frozen=True, slots=True, eq=False)
class Learned:
    """A spectrum and a detector of some things, alone or together."""

    spectrum: Spectrum
    detector: Detector


def learn(past: Things, given: Sensor | None) -> Learned:
    """From all things together, each with its own rhythm."""
    spectrum, sequences = fit(past.read, "static", 0, past.base), Sequences.of(past.read)
    p = predict_readings(spectrum, np.arange(past.read.n_cells), sequences, past.base).astype(np.float64)
    return Learned(spectrum, learn_detector(ReadCells(sequences, p), past.base.interval_s, given))


def filtered(learned: Learned, now: Things, every: int = 1) -> NDArray[np.float32]:
    """(n, n_samples / every): the probability in one of `every` samples given the readings up to it; before the first
    reading it is the rhythm's."""
    spectrum, sequences = learned.spectrum, Sequences.of(now.read)
    p = predict_readings(spectrum, np.arange(now.read.n_cells), sequences, now.base)
    beliefs = Beliefs.none(now.read.n_cells, learned.detector)
    samples = np.arange(0, now.read.n_samples, every)
    out = np.empty((now.read.n_cells, len(samples)), np.float32)
    for column, sample in enumerate(samples.tolist()):
        seen = (sequences.sample > sample - every) & (sequences.sample <= sample)
        beliefs = beliefs.filtered(sequences.select(seen), p[seen])
        model = predict(spectrum, float(now.base.time(sample)))[:, np.newaxis]
        out[:, column] = beliefs.condition(model, np.array([sample]))[:, 0]
    return out


def scores(p: NDArray[np.float32], truth: NDArray[np.uint8]) -> Scores:
    """Over all things and samples."""
    off, said = p.astype(np.float64) - truth, p > 0.5
    table = reliability(p.ravel(), truth.ravel())
    used = table.count > 0
    apart = np.abs(table.probability_mean - table.observed_rate)[used]
    return Scores(
        float(np.abs(off).mean()),
        float((said == truth).mean()),
        float(np.square(off).mean()),
        float((apart * table.count[used]).sum() / table.count.sum()),
    )
