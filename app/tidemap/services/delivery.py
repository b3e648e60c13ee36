"""Delivery: one anomaly to one webhook, in the form of Standard Webhooks.

Sent at least once, under an id that stays; what fails is tried again ever more rarely, and in the end put aside.
"""

import asyncio
import hmac
import random
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import httpx
import orjson

from tidemap.errors import AnomalyNotFoundError, DestinationError, SecretFileError
from tidemap.events.messages import enveloped
from tidemap.media_types import JSON
from tidemap.services.anomalies import get_event
from tidemap.services.context import Context
from tidemap.services.destinations import resolve
from tidemap.services.messages import anomaly_message
from tidemap.services.signing import open_signer, signature
from tidemap.storage.records import DeliveryRecord, WebhookRecord
from tidemap.storage.work import Work
from tidemap.version import __version__

ATTEMPT_S = 10.0
"""How long one attempt may take, from the look-up of the name to the head of the answer."""
RETRY_S: Sequence[float] = (5, 300, 1800, 7200, 18000, 36000, 50400, 72000, 86400)
"""Pauses after failed attempts, as Standard Webhooks recommends; after the last one a delivery has failed."""
MAX_CELLS = 1000
"""Cells of an event in a message: receivers take small bodies."""
MAX_WAITING = 10_000
"""Deliveries of a webhook that wait; further anomalies wait in their own table."""
KEPT = 1000
"""Deliveries of each state that are listed."""
GONE = 410
"""The receiver wants no more."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """What came of it: the HTTP status, or why there was none; `change` of an anomaly is the one that was sent."""

    status: int | None
    error: str | None
    change: int = 0

    @property
    def delivered(self) -> bool:
        """Whether the receiver has it."""
        return self.error is None


def add_due(ctx: Context, webhook_id: int) -> None:
    """Make deliveries of the changes since the webhook's cursor, as many as may wait; none where it is gone.

    A change of an anomaly whose delivery has not been tried yet is sent with that.
    """

    def add(work: Work) -> None:
        webhook = work.webhooks.find(webhook_id)
        room = MAX_WAITING - work.webhooks.waiting(webhook_id)
        if webhook is None or room <= 0:
            return
        latest = work.anomalies.latest()
        found = work.anomalies.changes_after(webhook.cursor, room, webhook.scope)
        # What another server stored between the two questions is in what was found.
        numbers = [number for number, _ in found]
        cursor = numbers[-1] if len(found) == room else max(latest, *numbers, 0)
        waiting = work.webhooks.untried(webhook.id)
        new = [id_ for _, id_ in found if id_ not in waiting]
        known = work.webhooks.known(webhook.id, new)
        messages = {id_: (new_message_id(), id_ in known) for id_ in new}
        work.webhooks.add_deliveries(webhook.id, messages, cursor, ctx.clock())

    ctx.store.write(add)


def next_due(ctx: Context, webhook_id: int) -> tuple[WebhookRecord, DeliveryRecord] | None:
    """What to send next, and the webhook as it is now; None where it is gone or disabled, or nothing is due."""
    with ctx.store.read() as work:
        webhook = work.webhooks.find(webhook_id)
        if webhook is None or not webhook.enabled:
            return None
        due = work.webhooks.due(webhook_id, ctx.clock(), 1)
    return (webhook, due[0]) if due else None


async def deliver(ctx: Context, webhook: WebhookRecord, delivery: DeliveryRecord) -> Attempt | None:
    """Try a delivery, of the anomaly as it is now; None where that is gone, part of another, snoozed or muted, or its
    location not the webhook's any more."""
    try:
        event = await asyncio.to_thread(get_event, ctx, delivery.anomaly_id)
    except AnomalyNotFoundError:
        return None
    silenced = event.muted or event.snoozed_until is not None
    if event.id != delivery.anomaly_id or silenced or not webhook.scope.holds(event.location):
        return None
    event = replace(event, cells=event.cells[:MAX_CELLS])
    data = anomaly_message(event, delivery.created_at, update=delivery.update).wire()
    attempt = await send(ctx, webhook, delivery.message_id, _body("anomaly", delivery.created_at, data))
    return replace(attempt, change=event.change)


async def send_test(ctx: Context, webhook: WebhookRecord) -> Attempt:
    """Try to send a message that says nothing, now."""
    return await send(ctx, webhook, new_message_id(), _body("test", ctx.clock(), {}))


async def send(ctx: Context, webhook: WebhookRecord, message_id: str, body: bytes) -> Attempt:
    """Send a signed body once. Redirects are not followed, and of the answer only the head is read."""
    try:
        async with asyncio.timeout(ATTEMPT_S):
            headers = _signed(ctx, webhook, message_id, body)
            status = await _post(webhook.url, ctx.settings.webhooks_private, body, headers)
    except TimeoutError:
        return Attempt(None, f"no answer within {ATTEMPT_S:g} s")
    except (DestinationError, SecretFileError) as error:
        return Attempt(None, str(error))
    except (httpx.HTTPError, httpx.InvalidURL, OSError) as error:
        return Attempt(None, f"{type(error).__name__}: {error}"[:500])
    return Attempt(status, None if 200 <= status < 300 else f"the receiver answered {status}")


def settle(ctx: Context, webhook: WebhookRecord, delivery: DeliveryRecord, attempt: Attempt | None) -> None:
    """Store what came of an attempt."""
    values = None if attempt is None else _after(ctx.clock(), delivery, attempt)

    def store(work: Work) -> None:
        if values is None or attempt is None:
            work.webhooks.drop_delivery(delivery.id)
            return
        work.webhooks.change_delivery(delivery.id, **values)
        if attempt.status == GONE:
            work.webhooks.disable(webhook.id, webhook.url)
        if values["state"] != "waiting":
            _add_passed(work, webhook.id, delivery, attempt.change, ctx.clock())
            work.webhooks.prune(webhook.id, values["state"], KEPT)

    ctx.store.write(store)


def _add_passed(work: Work, webhook_id: int, delivery: DeliveryRecord, sent: int, now: float) -> None:
    """Add a delivery of what has changed of an anomaly while this one was under way and was taken to go with it."""
    webhook, id_ = work.webhooks.find(webhook_id), delivery.anomaly_id
    number = work.anomalies.change_of(id_)
    if webhook is None or number is None or not sent < number <= webhook.cursor:
        return
    if id_ not in work.webhooks.untried(webhook_id):
        work.webhooks.add_deliveries(webhook_id, {id_: (new_message_id(), True)}, webhook.cursor, now)


def new_message_id() -> str:
    """The id of a message, the same in every attempt."""
    return f"msg_{secrets.token_urlsafe(18)}"


def _after(now: float, delivery: DeliveryRecord, attempt: Attempt) -> dict[str, Any]:
    """The row of a delivery after an attempt."""
    values = {"attempts": delivery.attempts + 1, "status": attempt.status, "error": attempt.error}
    if attempt.delivered:
        return values | {"state": "delivered", "finished_at": now}
    if attempt.status == GONE or delivery.attempts >= len(RETRY_S):
        return values | {"state": "failed", "finished_at": now}
    return values | {"state": "waiting", "next_at": now + RETRY_S[delivery.attempts] * random.uniform(1, 1.1)}


def _body(kind: str, time: float, data: Mapping[str, Any]) -> bytes:
    return orjson.dumps(enveloped(kind, time, data))


def _signed(ctx: Context, webhook: WebhookRecord, message_id: str, body: bytes) -> dict[str, str]:
    """The headers of a message. Raises SecretFileError."""
    signer, timestamp = open_signer(ctx.settings), int(ctx.clock())
    if not hmac.compare_digest(signer.fingerprint(webhook.salt), webhook.fingerprint):
        raise SecretFileError(ctx.settings.secret_path, "it is not the one that this webhook was made with")
    return {
        "content-type": JSON,
        "user-agent": f"tidemap/{__version__}",
        "webhook-id": message_id,
        "webhook-timestamp": str(timestamp),
        "webhook-signature": signature(signer.secret(webhook.salt), message_id, timestamp, body),
    }


async def _post(url: str, private: bool, body: bytes, headers: Mapping[str, str]) -> int:
    """The status of the answer. Raises DestinationError, httpx.HTTPError."""
    there = await resolve(url, private)
    how: dict[str, Any] = {"headers": {**headers, "host": there.header}, "content": body}
    async with (
        httpx.AsyncClient(trust_env=False, timeout=ATTEMPT_S) as http,
        http.stream("POST", there.url, **how, extensions={"sni_hostname": there.host}) as answer,
    ):
        return answer.status_code
