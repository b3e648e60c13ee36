"""Webhooks: who is sent anomalies, and what has become of what was sent."""

from dataclasses import dataclass
from typing import Any, Literal

from tidemap.errors import TooManyWebhooksError
from tidemap.scope import Scope
from tidemap.services.context import Context
from tidemap.services.destinations import check_destination
from tidemap.services.signing import new_salt, prepare_signer, shown_secret
from tidemap.storage.records import DeliveryRecord, WebhookRecord
from tidemap.storage.work import Work

MAX_WEBHOOKS = 100
DeliveryState = Literal["waiting", "delivered", "failed"]


@dataclass(frozen=True, slots=True)
class IssuedWebhook:
    """A webhook with its secret, which is not stored."""

    record: WebhookRecord
    secret: str


def create_webhook(ctx: Context, url: str, description: str, scope: Scope) -> IssuedWebhook:
    """One that is sent the anomalies from now on. Raises InvalidInputError, TooManyWebhooksError, SecretFileError."""
    check_destination(url, ctx.settings.webhooks_private)
    signer, salt = prepare_signer(ctx.settings), new_salt()
    values = {
        "url": url,
        "description": description,
        "locations": scope.dumped(),
        "enabled": True,
        "salt": salt,
        "fingerprint": signer.fingerprint(salt),
        "created_at": ctx.clock(),
    }

    def create(work: Work) -> WebhookRecord:
        if work.webhooks.count() >= MAX_WEBHOOKS:
            raise TooManyWebhooksError(MAX_WEBHOOKS)
        return work.webhooks.create(values | {"cursor": work.anomalies.latest()})

    return IssuedWebhook(ctx.store.write(create), shown_secret(signer.secret(salt)))


def list_webhooks(ctx: Context, after: int | None, limit: int) -> list[WebhookRecord]:
    """In order of creation; `after` is the last id of the page before."""
    with ctx.store.read() as work:
        return work.webhooks.list(after, limit)


def get_webhook(ctx: Context, webhook_id: int) -> WebhookRecord:
    """Raises WebhookNotFoundError."""
    with ctx.store.read() as work:
        return work.webhooks.get(webhook_id)


def change_webhook(ctx: Context, webhook_id: int, values: dict[str, Any]) -> WebhookRecord:
    """Change what is given of url, description, scope and enabled. Raises WebhookNotFoundError, InvalidInputError."""
    if "url" in values:
        check_destination(values["url"], ctx.settings.webhooks_private)
    if "scope" in values:
        values = {**values, "locations": values["scope"].dumped()}
        del values["scope"]
    return ctx.store.write(lambda work: work.webhooks.change(webhook_id, values))


def delete_webhook(ctx: Context, webhook_id: int) -> None:
    """With its deliveries. Raises WebhookNotFoundError."""
    ctx.store.write(lambda work: work.webhooks.delete(webhook_id))


def list_deliveries(
    ctx: Context, webhook_id: int, state: DeliveryState | None, before: int | None, limit: int
) -> list[DeliveryRecord]:
    """Newest first; `before` is the last id of the page before. Raises WebhookNotFoundError."""
    with ctx.store.read() as work:
        return work.webhooks.deliveries(webhook_id, state, before, limit)


def retry_delivery(ctx: Context, webhook_id: int, delivery_id: int) -> DeliveryRecord:
    """Let a delivery be tried again at once, from the first attempt on. Raises DeliveryNotFoundError."""

    def retry(work: Work) -> DeliveryRecord:
        work.webhooks.get_delivery(webhook_id, delivery_id)
        again = {"state": "waiting", "attempts": 0, "next_at": ctx.clock(), "finished_at": None}
        work.webhooks.change_delivery(delivery_id, **again)
        return work.webhooks.get_delivery(webhook_id, delivery_id)

    return ctx.store.write(retry)
