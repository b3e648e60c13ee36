"""Webhooks as the API shows them."""

from typing import Any

from tidemap.schemas.webhooks import Delivery, NewWebhook, Webhook
from tidemap.services import webhooks
from tidemap.storage.records import DeliveryRecord, WebhookRecord


def webhook_view(record: WebhookRecord) -> Webhook:
    """A webhook without its secret."""
    return Webhook(**_fields(record))


def new_webhook_view(made: webhooks.IssuedWebhook) -> NewWebhook:
    """A new webhook with its secret."""
    return NewWebhook(**_fields(made.record), secret=made.secret)


def delivery_view(record: DeliveryRecord) -> Delivery:
    """A delivery."""
    return Delivery(**{name: getattr(record, name) for name in Delivery.model_fields})


def _fields(record: WebhookRecord) -> dict[str, Any]:
    named = {name: getattr(record, name) for name in Webhook.model_fields if hasattr(record, name)}
    patterns = record.scope.patterns
    return named | {"locations": None if patterns is None else list(patterns)}
