"""Webhooks on the wire."""

from typing import Literal

from pydantic import Field

from tidemap.schemas.common import Answer, Form, Text, TimeOut, shown
from tidemap.schemas.patterns import LocationPatterns

MAX_URL = 2000


class WebhookForm(Form):
    """A receiver of anomalies: a URL, and the locations it is for (default: all)."""

    model_config = shown({"url": "https://alarms.example.org/tidemap", "locations": ["hall", "floor-2-*"]})

    url: Text = Field(min_length=1, max_length=MAX_URL)
    description: Text = Field("", max_length=128)
    locations: LocationPatterns | None = None


class WebhookPatch(Form):
    """What to change; `locations` null: all. A webhook that is not `enabled` goes on later where it stopped."""

    model_config = shown({"enabled": False})

    url: Text = Field("", min_length=1, max_length=MAX_URL)
    description: Text = Field("", max_length=128)
    locations: LocationPatterns | None = None
    enabled: bool = True


class Webhook(Answer):
    """A receiver of anomalies, without its secret."""

    id: int
    url: str
    description: str
    locations: list[str] | None
    enabled: bool
    created_at: TimeOut


class NewWebhook(Webhook):
    """A webhook with the secret to check signatures with, shown this once."""

    secret: str


class WebhookTest(Answer):
    """What came of a test message: `status` is the receiver's, null where it gave none."""

    delivered: bool
    status: int | None
    error: str | None


class Delivery(Answer):
    """A change of an anomaly for one receiver. `message_id` is its `webhook-id` in every attempt.

    `update`: the receiver has had the anomaly before. Those of one anomaly are sent one after the other.
    `waiting` is tried again at `next_at`; `failed` is put aside after ten attempts, and can be retried.
    """

    id: int
    anomaly_id: int
    message_id: str
    state: Literal["waiting", "delivered", "failed"]
    attempts: int
    next_at: TimeOut
    status: int | None
    error: str | None
    created_at: TimeOut
    finished_at: TimeOut | None
    update: bool
