"""Models and evaluations as the API shows them."""

from dataclasses import asdict

import numpy as np

from tidemap.schemas.maps import (
    Best,
    Component,
    Compression,
    Evaluation,
    EvaluationRow,
    HorizonRow,
    LearnedSensor,
    Model,
    ModelScores,
    ReliabilityRow,
    Selection,
)
from tidemap.services.evaluate import Comparison, ScoredCandidate
from tidemap.services.horizons import HorizonScores, ScoredAnswers
from tidemap.services.model import CellModel
from tidemap.spectral.detector import Detector
from tidemap.spectral.evaluation import Reliability
from tidemap.spectral.spectrum import WEEKEND, Spectrum, components


def model_view(model: CellModel) -> Model:
    """The spectrum and the outliers of one cell."""
    spectrum, revision, base = model.spectrum, model.revision, model.location.base
    return Model(
        cell=model.cell,
        estimator=revision.estimator,
        link=spectrum.link,
        time_zone=spectrum.time_zone,
        order=revision.order,
        start=float(base.time(revision.start)),
        stop=float(base.time(revision.stop)),
        samples=revision.stop - revision.start,
        interval_s=model.location.interval_s,
        mean=None if np.isnan(spectrum.mean[0]) else float(spectrum.mean[0]),
        components=_components(spectrum),
        outliers=[(start, stop) for start, stop in model.outliers.tolist()],
        accuracy=model.accuracy,
        compression=Compression(**{name: getattr(model.cost, name) for name in Compression.model_fields}),
        selection=None if revision.selection is None else Selection(**revision.selection),
        sensor=None if revision.detector is None else _sensor(revision.detector),
        revision=revision.revision,
    )


def _sensor(found: Detector) -> LearnedSensor:
    return LearnedSensor(**asdict(found.sensor), readings=found.readings, reason=found.reason)


def _components(spectrum: Spectrum) -> list[Component]:
    table = components(spectrum, 0)
    rows = zip(table.amplitude, table.phase, table.frequency_hz, table.gate, strict=True)
    return [
        Component(
            amplitude=float(amplitude),
            phase=float(phase),
            frequency_hz=float(frequency),
            period_s=float(1 / frequency) if frequency else None,
            gate="weekend" if gate == WEEKEND else None,
        )
        for amplitude, phase, frequency, gate in rows
    ]


def evaluation_view(found: Comparison) -> Evaluation:
    """All scores, the best, the reliability table of the best, and the scores by horizon."""
    best = found.best
    return Evaluation(
        results=[_row(each) for each in found.candidates],
        best=None if best is None else Best(estimator=best.estimator, order=best.order),
        reliability=[] if found.reliability is None else _reliability(found.reliability),
        horizons=[_horizon(each) for each in found.horizons],
        revision=found.revision,
    )


def _horizon(each: HorizonScores) -> HorizonRow:
    return HorizonRow(
        horizon_s=each.horizon_s,
        samples=each.samples,
        conditioned=_scores(each.conditioned),
        rhythm=_scores(each.rhythm),
        persistence=_scores(each.persistence),
    )


def _scores(found: ScoredAnswers) -> ModelScores:
    figures = {**asdict(found.scores), "calibration_error": found.calibration_error}
    known = {name: None if np.isnan(value) else value for name, value in figures.items()}
    return ModelScores(**known, reliability=_reliability(found.reliability))


def _row(each: ScoredCandidate) -> EvaluationRow:
    return EvaluationRow(estimator=each.estimator, order=each.order, **asdict(each.scores))


def _reliability(table: Reliability) -> list[ReliabilityRow]:
    """The bins that are not empty."""
    rows = zip(table.probability_mean, table.observed_rate, table.count, strict=True)
    return [ReliabilityRow(probability=float(p), observed=float(s), n=int(n)) for p, s, n in rows if n]
