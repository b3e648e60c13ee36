"""The sender of webhooks: while this process leads, it sends what is due, to each receiver apart from the others."""

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from tidemap.errors import BusyError, ShuttingDownError
from tidemap.events.subscription import EventFilter, listen
from tidemap.services.context import Context
from tidemap.services.delivery import Attempt, add_due, deliver, next_due, settle
from tidemap.storage.records import DeliveryRecord, WebhookRecord
from tidemap.workers.election import LeaderElection
from tidemap.workers.worker import Worker

log = logging.getLogger(__name__)
ANOMALIES = EventFilter(kinds=frozenset({"anomaly"}))
POLL_S = 1.0
"""How often to look for anomalies of other processes, and for what is to be tried again."""
STOP_POLL_S = 0.2
BATCH = 100
"""Deliveries to one receiver, one after the other, before its thread is for another one."""
RECEIVERS = 8
"""Receivers that are sent to at once."""


class WebhookSender:
    """One thread that finds what is due, and some that send it: a receiver that is slow holds up itself."""

    def __init__(self, ctx: Context, election: LeaderElection) -> None:
        self._ctx = ctx
        self._election = election
        self._worker = Worker("webhooks", POLL_S, self._round)
        self._busy: dict[int, Future[None]] = {}
        self._pool = ThreadPoolExecutor(RECEIVERS, "tidemap-webhook")
        self._unsubscribe: Callable[[], None] = lambda: None
        election.on_begin(self._worker.wake)

    def start(self) -> None:
        """Begin."""
        self._unsubscribe = listen(self._ctx.bus, ANOMALIES, lambda _: self._worker.wake())
        self._worker.start()

    def request_stop(self) -> None:
        """Send nothing more. What is under way may have arrived: it is sent again later, under the same id."""
        self._unsubscribe()
        self._worker.request_stop()

    def stop(self) -> None:
        """End."""
        self.request_stop()
        self._worker.join()
        self._pool.shutdown()

    def alive(self) -> bool:
        """Whether it is at work."""
        return self._worker.alive()

    def _round(self) -> None:
        term = self._election.term
        if term is None:
            return
        ctx = term.limit(self._ctx)
        with ctx.store.read() as work:
            webhooks, latest = [each for each in work.webhooks.list() if each.enabled], work.anomalies.latest()
        for webhook in webhooks:
            self._worker.check()
            if webhook.cursor < latest:
                add_due(ctx, webhook.id)
            if webhook.id not in self._busy or self._busy[webhook.id].done():
                self._begin(ctx, webhook.id)

    def _begin(self, ctx: Context, webhook_id: int) -> None:
        if next_due(ctx, webhook_id) is not None:
            self._busy[webhook_id] = self._pool.submit(self._send_all, ctx, webhook_id)

    def _send_all(self, ctx: Context, webhook_id: int) -> None:
        try:
            if self._send_batch(ctx, webhook_id):
                # There may be more.
                self._worker.wake()
        except BusyError as error:
            log.debug("webhook %d waits: %s", webhook_id, error.title)
        except Exception:
            log.exception("webhook %d failed and goes on", webhook_id)

    def _send_batch(self, ctx: Context, webhook_id: int) -> bool:
        """Send what is due, each to the webhook as it is by then; False once an attempt had no answer.

        Such a receiver may cost ATTEMPT_S each time, so the thread goes to another one in between.
        """
        for _ in range(BATCH):
            found = next_due(ctx, webhook_id)
            if found is None:
                break
            attempt = asyncio.run(self._send(ctx, *found))
            settle(ctx, *found, attempt)
            if attempt is not None and attempt.status is None:
                return False
        return True

    async def _send(self, ctx: Context, webhook: WebhookRecord, delivery: DeliveryRecord) -> Attempt | None:
        """An attempt; what is still under way when the sender is to stop is broken off with ShuttingDownError."""
        attempt = asyncio.create_task(deliver(ctx, webhook, delivery))
        while not attempt.done():
            try:
                self._worker.check()
            except ShuttingDownError:
                attempt.cancel()
                raise
            await asyncio.wait({attempt}, timeout=STOP_POLL_S)
        return attempt.result()
