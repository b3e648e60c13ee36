"""Warming: the kernels compiled, or loaded from the cache on disk, before the first request."""

from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.formats import pcd
from tidemap.history.combining import ANY, LATEST, MAJORITY
from tidemap.history.erasing import erase
from tidemap.history.film import Film
from tidemap.history.history import History
from tidemap.history.measurements import Measurements
from tidemap.history.runs import LatestRuns
from tidemap.history.segment import Segment, merge
from tidemap.history.sequences import Sequences
from tidemap.history.snapshot import sort_snapshot
from tidemap.history.timebase import TimeBase
from tidemap.space.grid import GridGeometry
from tidemap.space.pose import Pose
from tidemap.space.regions import Spans, label_regions, link
from tidemap.space.scan import Scan
from tidemap.spectral.anomaly import surprising
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.belief import Beliefs
from tidemap.spectral.conditioning import UNLEARNED, Evidence
from tidemap.spectral.detection import ReadCells, learn_detector
from tidemap.spectral.model import add, reconstruct, update
from tidemap.spectral.prediction import predict, predict_readings, predict_times
from tidemap.spectral.spectrum import Spectrum
from tidemap.spectral.state_columns import StateColumns, Waves, write_conditioned, write_waves
from tidemap.storage.blobs import pack_measurements, pack_segment, unpack_measurements, unpack_segment

COMPRESSED = (
    b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA binary_compressed\n"
    + np.array([13, 12], "<u4").tobytes()
    + bytes([11, *range(12)])
)
"""A cloud of one point, packed as literals."""


@cache
def warm() -> None:
    """Run everything once on a few samples; a minute when nothing is cached, else a second, and none later on.

    Also on read-only planes, which is what arrays over stored bytes are.
    """
    _post()
    _scan()
    _compact()
    _fit_and_ask()


def _post() -> None:
    snapshot = sort_snapshot(np.zeros(1), np.zeros(1, np.uint32), np.zeros(1, np.uint8), (0.0, 1.0), 1)
    if snapshot is not None:
        unpack_measurements(pack_measurements(snapshot), "a snapshot")
    zero = np.zeros(1, np.int64)
    label_regions(GridGeometry("", (0.0, 0.0, 0.0), 1.0, (1,)), zero, zero)
    link(Spans(zero, zero, np.zeros(1, np.uint8), zero, zero), 0)


def _scan() -> None:
    points = np.array([[0.5, 0.0, 0.0], [9.0, 1.0, 0.5]], np.float32)
    for each in (points, _read_only(points)):
        Scan(each, Pose.of(np.eye(4)), max_range_m=5.0).cast(GridGeometry("", (0.0, 0.0, 0.0), 1.0, (2, 2, 2)))
    for content in COMPRESSED, bytearray(COMPRESSED):
        pcd.read(content)


def _compact() -> None:
    base = TimeBase(0.0, 60.0)
    once = Measurements(np.zeros(1), np.zeros(1, np.uint32), np.zeros(1, np.uint8))
    twice = Measurements(np.arange(2.0), np.arange(2, dtype=np.uint32), np.zeros(2, np.uint8))
    for measurements, combine in product((once, twice), (LATEST, ANY, MAJORITY)):
        segment = merge(Segment.empty(2, 0), measurements, base, combine)
        stored = unpack_segment(pack_segment(segment), 0, "a segment")
        pack_segment(merge(stored, twice, base, combine))
        pack_segment(erase(stored, stored.time < 1, base)[0])


def _film(history: History) -> None:
    film = Film.blank(history.n_cells, 0, 4)
    film.lay(0, history)
    film.put(np.zeros(1, np.uint32), np.zeros(1, np.int64), np.zeros(1, np.uint8))
    film.at(100)


def _fit_and_ask() -> None:
    states = (np.arange(4 * 200).reshape(4, 200) % 7 < 3).astype(np.uint8)
    states[3] = 1
    states[1, 50:60], states[2:, 1::2] = 2, 2
    fresh = History.from_states(states, start=3)
    stored = replace(fresh, observed=_read_only(fresh.observed), occupied=_read_only(fresh.occupied))
    base = TimeBase(0.0, 60.0)
    for history in (fresh, stored):
        model = update(history.window(0, 150), "fft", 3, base)
        reconstruct(update(history, "calendar", 3, base))
        update(history, "fft", 3, base)
        reconstruct(add(model, 170, 1))
        history.hold(2)
        history.last_seen(100)
        _film(history)
        runs = LatestRuns.none(history.n_cells)
        runs.extend(history, 100)
        age = np.ones(history.n_cells, np.uint32)
        evidence = Evidence(runs.state, runs.sample, age, np.ones(history.n_cells, np.float32))
        evidence.condition(np.full((history.n_cells, 1), 0.5, np.float32), np.array([200]), 60.0, UNLEARNED)
        _believe(history, model.spectrum, base)
        history.ever_observed()
        History.from_intervals(history.intervals())
        kept = replace(
            model.spectrum,
            mean=_read_only(model.spectrum.mean),
            cell=_read_only(model.spectrum.cell),
            index=_read_only(model.spectrum.index),
            coefficient=_read_only(model.spectrum.coefficient),
            frequency_hz=_read_only(model.spectrum.frequency_hz),
        )
        for spectrum in (model.spectrum, kept, replace(kept, time_zone="UTC")):
            predict(spectrum, 0.0)
            predict(spectrum, 0.0, [0])
            n = spectrum.n_cells
            answer = StateColumns(np.zeros(n, np.float32), np.zeros(n, np.uint8), np.zeros(n, np.uint8))
            write_waves(spectrum, 0.0, 0.5, spectrum.cell, answer)
            waves = Waves.of(spectrum, spectrum.cell, 0.0)
            write_conditioned(waves, answer.probability.copy(), lambda _, p, out: np.copyto(out, p), 0.5, answer)
            predict_times(spectrum, [0.0, 1.0])
            surprising(spectrum, 0.0, np.zeros(1, np.uint32), np.zeros(1, np.uint8), 0.9)
            reconstruct(replace(model, spectrum=spectrum))
    days = History.from_states((np.arange(2 * 4500).reshape(2, 4500) % 1440 < 500).astype(np.uint8))
    reconstruct(update(days, "calendar", 3, base))
    choose(days, base, time_zone="UTC")


def _believe(history: History, spectrum: Spectrum, base: TimeBase) -> None:
    sequences = Sequences.of(history)
    p = predict_readings(spectrum, np.arange(history.n_cells), sequences, base)
    detector = learn_detector(ReadCells(sequences, p.astype(np.float64)), base.interval_s)
    beliefs = Beliefs.none(history.n_cells, detector).filtered(sequences, p)
    beliefs.condition(np.full((history.n_cells, 1), 0.5, np.float32), np.array([200]))
    beliefs.traced(sequences, p).ahead(p, sequences.sample, 1, 0)


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    copy = array.copy()
    copy.flags.writeable = False
    return copy


if __name__ == "__main__":
    warm()
