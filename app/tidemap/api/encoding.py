"""Large answers from arrays: JSON, Arrow or npy, without a Python object per cell."""

import asyncio
import hashlib
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from typing import Any

import numpy as np
from fastapi import Request
from numpy.typing import NDArray
from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from tidemap.api.connections import abort
from tidemap.formats import json_columns
from tidemap.formats.npy import write_grid
from tidemap.formats.registry import WRITERS
from tidemap.formats.table import Column, Labels, Nullable
from tidemap.history.history import UNOBSERVED
from tidemap.media_types import ARROW, JSON, NPY
from tidemap.schemas.common import iso
from tidemap.services.context import Context
from tidemap.services.density import Density
from tidemap.services.information import InformationView
from tidemap.services.predict import PredictionView
from tidemap.services.series import SeriesView
from tidemap.services.state import Asked, BufferedState, StateFacts, StateView, buffer_of, grid_of, view_of
from tidemap.services.state_buffer import seen_columns
from tidemap.spectral.prediction import VERDICTS

PIECE_BYTES = 1 << 16
"""What is handed to the connection at once; it takes the next one when its own buffer has room."""
MAX_STALL_S = 60.0
"""How long a reader may take nothing of an answer that holds memory of the budget."""


def preferred(request: Request, offered: tuple[str, ...]) -> str:
    """The first offered media type that Accept names, the first of all otherwise."""
    accepted = [part.partition(";")[0].strip().lower() for part in request.headers.get("accept", "").split(",")]
    return next((each for each in accepted if each in offered), offered[0])


def with_etag(request: Request, key: tuple[object, ...], respond: Callable[[], Response]) -> Response:
    """304 when the asker holds this version already, else the response with its ETag."""
    etag = '"' + hashlib.sha256(repr(key).encode()).hexdigest()[:32] + '"'
    headers = etag_headers(etag)
    if holds(request.headers, etag):
        return Response(status_code=304, headers=headers)
    response = respond()
    response.headers.update(headers)
    return response


def holds(headers: Headers, etag: str) -> bool:
    """Whether an asker holds this version, as the request's headers say."""
    return etag in (each.strip().removeprefix("W/") for each in headers.get("if-none-match", "").split(","))


def etag_headers(etag: str) -> dict[str, str]:
    """What an answer of this version says, and one without it."""
    return {"ETag": etag, "Cache-Control": "private, no-cache", "Vary": "Accept, Authorization, Cookie"}


class Parts(Response):
    """A response of several pieces of memory, each sent as it lies: put together they would be copied."""

    def __init__(self, parts: Sequence[bytes | memoryview], media_type: str) -> None:
        length = sum(memoryview(part).nbytes for part in parts)
        super().__init__(headers={"content-length": str(length)}, media_type=media_type)
        self._parts = parts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send all parts."""
        await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
        *before, last = self._parts
        for part in before:
            await send({"type": "http.response.body", "body": part, "more_body": True})
        await send({"type": "http.response.body", "body": last})


class LeasedResponse(Response):
    """A response that holds its memory of a budget until it is sent; a reader who pauses too long is cut off."""

    def __init__(self, content: bytes, media_type: str, lease: ExitStack) -> None:
        super().__init__(content, media_type=media_type)
        self._lease = lease

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it in pieces, each when there is room for it, and then give the memory back."""
        with self._lease:
            await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
            content = memoryview(self.body)
            try:
                for begin in range(0, len(content), PIECE_BYTES):
                    piece = bytes(content[begin : begin + PIECE_BYTES])
                    async with asyncio.timeout(MAX_STALL_S):
                        await send({"type": "http.response.body", "body": piece, "more_body": True})
            except TimeoutError:
                abort(scope)
                return
            await send({"type": "http.response.body", "body": b""})


def encode_answer(ctx: Context, asked: Asked, media_type: str) -> Response:
    """The answer to a question for one time, in JSON, Arrow or npy; a whole map in Arrow from its buffer."""
    response = _encoded(ctx, asked, media_type)
    response.headers["Tidemap-Revision"] = str(asked.facts().revision)
    return response


def _encoded(ctx: Context, asked: Asked, media_type: str) -> Response:
    if media_type == NPY:
        return encode_grid(grid_of(ctx, asked))
    buffered = buffer_of(ctx, asked) if media_type == ARROW else None
    return encode_state(view_of(ctx, asked), media_type) if buffered is None else encode_buffer(buffered)


def encode_buffer(answer: BufferedState) -> Response:
    """The answer to a question about a whole map, in Arrow."""
    return Parts((answer.lease.value.arrow.head(_state_facts(answer.facts)), answer.lease.memory.data), ARROW)


def encode_grid(grid: NDArray[np.float32]) -> Response:
    """A dense grid of probabilities in npy."""
    return Parts(write_grid(grid), NPY)


def encode_state(view: StateView, media_type: str) -> Response:
    """The answer to a question for one time, in one of `WRITERS`."""
    return Parts(WRITERS[media_type](_state_facts(view), _state_columns(view)), media_type)


def _state_facts(view: StateFacts) -> dict[str, Any]:
    return {
        "time": iso(view.time),
        "as_of": iso(view.as_of),
        "given": view.given,
        "confidence": view.confidence,
        "estimator": view.estimator,
        "order": view.order,
        "revision": view.revision,
        "shape": list(view.shape),
        "grid": None if view.grid is None else asdict(view.grid),
        "unavailable": view.unavailable,
    }


def _state_columns(view: StateView) -> dict[str, Column]:
    columns: dict[str, Column] = {
        "cell": view.cell.astype(np.uint32),
        "probability": view.probability,
        "state": view.state,
        "verdict": Labels(view.verdict, VERDICTS),
    }
    if view.observed is not None and view.observed_time is not None:
        columns |= seen_columns(view.observed, view.observed_time)
    if view.last_seen is not None:
        columns["last_seen"] = Nullable(view.last_seen, np.isnan(view.last_seen))
    return columns


def _states(states: NDArray[np.uint8]) -> Nullable:
    return Nullable(states, states == UNOBSERVED)


def encode_prediction(view: PredictionView) -> Response:
    """The answer to a question for many times."""
    content = {
        "time": view.time,
        "cell": view.cell,
        "confidence": view.confidence,
        "probability": view.probability,
        "state": _states(view.state),
        "entropy": view.entropy,
        "as_of": iso(view.as_of),
        "given": view.given,
        "revision": view.revision,
        "unavailable": view.unavailable,
    }
    return Parts(json_columns.write(content), JSON)


def encode_series(view: SeriesView) -> Response:
    """One cell over time."""
    content = {
        "cell": view.cell,
        "time": view.time,
        "probability": view.probability,
        "state": _states(view.state),
        "observed": _states(view.observed),
        "revision": view.revision,
    }
    return Parts(json_columns.write(content), JSON)


def encode_density(found: Density) -> Response:
    """How much was observed when."""
    content = {
        "time": found.time,
        "step_s": found.step_s,
        "step_samples": found.step_samples,
        "measurements": found.measurements,
        "samples": found.samples,
        "cells": found.n_counted,
    }
    return Parts(json_columns.write(content), JSON)


def encode_information(view: InformationView) -> Response:
    """What looking is expected to say, per time, and per cell where one time was asked for."""
    rows = zip(view.time[view.best].tolist(), view.information[view.best].tolist(), strict=True)
    content = {
        "time": view.time,
        "entropy": view.entropy,
        "information": view.information,
        "cells": view.n_cells,
        "best": [{"time": time, "information": value} for time, value in rows],
        "apart_s": view.apart_s,
        "as_of": iso(view.as_of),
        "given": view.given,
        "revision": view.revision,
        "unavailable": view.unavailable,
    }
    if view.cells is not None:
        content |= {
            "cell": view.cells.cell,
            "cell_entropy": view.cells.entropy,
            "cell_information": view.cells.information,
        }
    return Parts(json_columns.write(content), JSON)
