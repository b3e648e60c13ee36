"""The thread that empties the outbox."""

import logging
import threading
from contextlib import closing
from pathlib import Path

import httpx

from tidemap.client.errors import OutboxError, TidemapError
from tidemap.client.outbox.backoff import ALL, Backoff
from tidemap.client.outbox.lock import SenderLock
from tidemap.client.outbox.outcome import SendOutcome, Verdict, judge, words
from tidemap.client.outbox.splitting import halves
from tidemap.client.outbox.store import Kept, OutboxStore
from tidemap.client.retry import RetryPolicy
from tidemap.client.transport import Server

log = logging.getLogger(__name__)

POLL_S = 0.5
"""How often to look for what other processes have put into the file, and whether the one that sends is gone."""
CONNECT_S = 5.0
"""A robot out of range should notice soon that it is back."""
WRONG_INPUT = 422
"""Something in a batch is wrong: the rest of it may not be."""
STOP_S = 5.0
"""How long to wait for a request under way. What it carries stays in the file if it is not answered."""


class Sender:
    """Sends what is in the outbox at `path` to a server: in order for each location, and without end.

    What is refused for some of its measurements is sent in ever smaller parts, behind the others."""

    def __init__(self, path: Path, server: Server, timeout_s: float, retry: RetryPolicy) -> None:
        self._path = path
        self._server = server
        self._timeout = httpx.Timeout(timeout_s, connect=min(timeout_s, CONNECT_S))
        self._backoff = Backoff(retry)
        self._woken = threading.Event()
        self._hurried = threading.Event()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tidemap-outbox", daemon=True)
        self._last_words = ""

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def wake(self) -> None:
        """Something was put into the file."""
        self._woken.set()

    def hurry(self) -> None:
        """Try now, without waiting for the end of a pause, unless the server asked for it."""
        self._hurried.set()
        self._woken.set()

    def stop(self) -> None:
        """End the thread: it sends no further batch."""
        self._stopped.set()
        self._woken.set()
        self._thread.join(STOP_S)

    def _run(self) -> None:
        while not self._stopped.is_set():
            try:
                self._work()
            except Exception as error:
                # Whatever it was: a thread that ended would keep the rest from the server without a word.
                unexpected = None if isinstance(error, OutboxError) else error
                self._say("the outbox could not go on sending", error, unexpected)
                self._backoff.failed(ALL, None)
                self._stopped.wait(self._backoff.left_s())

    def _work(self) -> None:
        server = self._server
        with (
            closing(SenderLock(self._path)) as lock,
            closing(OutboxStore(self._path, durable=False)) as store,
            server.open(httpx.Client, self._timeout) as http,
        ):
            store.tidy()
            while not self._stopped.is_set():
                self._woken.wait(self._step(lock, store, http))
                self._woken.clear()

    def _step(self, lock: SenderLock, store: OutboxStore, http: httpx.Client) -> float:
        """Send the next batch if there is one to send now. Seconds until there is sense in another step."""
        if self._hurried.is_set():
            self._hurried.clear()
            self._backoff.hurry()
        if not lock.taken():
            return POLL_S
        if (left_s := self._backoff.left_s()) > 0:
            return left_s
        kept = store.first(but=self._backoff.paths())
        if kept is None:
            store.shrink()
            return max(0.0, min(self._backoff.next_s(), POLL_S))
        self._decide(store, kept, self._sent(http, kept))
        return 0.0

    def _sent(self, http: httpx.Client, kept: Kept) -> Verdict:
        if kept.damaged:
            return Verdict(
                SendOutcome.REFUSED, TidemapError(0, "Damaged", "the bytes on the disk are not those written")
            )
        path = kept.batch.path
        try:
            return judge(path, http.request(**kept.batch.request().arguments()))
        except httpx.RequestError as error:
            return judge(path, error)

    def _decide(self, store: OutboxStore, kept: Kept, verdict: Verdict) -> None:
        path, error = kept.batch.path, verdict.error
        if error is None:
            store.sent(kept.id)
            self._backoff.answered(path)
            self._last_words = ""
        elif error.status == WRONG_INPUT and (parts := halves(kept.batch)) is not None:
            store.split(kept.id, parts)
            self._backoff.answered(path)
        elif verdict.outcome is SendOutcome.REFUSED:
            log.warning("%s refused %d measurements: %s", path, kept.batch.measurements, words(error))
            store.refuse(kept.id, error.status, words(error))
            self._backoff.answered(path)
        else:
            self._say(f"the outbox waits at {path}", words(error))
            self._backoff.failed(ALL if verdict.outcome is SendOutcome.ALL_WAIT else path, error.retry_after_s)
            store.failed(kept.id, words(error))

    def _say(self, what: str, why: object, traceback: Exception | None = None) -> None:
        """Log why nothing is sent, but not the same again and again."""
        if (said := f"{what}: {why}") != self._last_words:
            log.warning("%s", said, exc_info=traceback)
        self._last_words = said
