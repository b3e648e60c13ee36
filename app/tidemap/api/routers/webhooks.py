"""/webhooks"""

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query
from starlette.concurrency import run_in_threadpool

from tidemap.api.bodies import FormRoute
from tidemap.api.dependencies import Admin, After, Audited, Ctx, Id, Limit, cursor
from tidemap.api.views.webhooks import delivery_view, new_webhook_view, webhook_view
from tidemap.schemas.common import Page
from tidemap.schemas.webhooks import Delivery, NewWebhook, Webhook, WebhookForm, WebhookPatch, WebhookTest
from tidemap.scope import Scope
from tidemap.services import webhooks
from tidemap.services.delivery import send_test
from tidemap.services.webhooks import DeliveryState

router = APIRouter(prefix="/webhooks", tags=["webhooks"], route_class=FormRoute)
State = Annotated[DeliveryState | None, Query(description="`failed` lists those that are put aside.")]


@router.get("")
def list_all(ctx: Ctx, _: Admin, limit: Limit = 100, after: After = None) -> Page[Webhook]:
    """Webhooks without their secrets, in order of creation."""
    items = [webhook_view(each) for each in webhooks.list_webhooks(ctx, cursor("after", after), limit + 1)]
    return Page(items=items[:limit], next=str(items[limit - 1].id) if len(items) > limit else None)


@router.post("", status_code=201)
def create(form: WebhookForm, ctx: Audited, _: Admin) -> NewWebhook:
    """Send every anomaly from now on to a URL, signed (Standard Webhooks); its secret is shown this once."""
    return new_webhook_view(webhooks.create_webhook(ctx, form.url, form.description, Scope.of(form.locations)))


@router.get("/{webhook_id}")
def get(webhook_id: Id, ctx: Ctx, _: Admin) -> Webhook:
    """One webhook."""
    return webhook_view(webhooks.get_webhook(ctx, webhook_id))


@router.patch("/{webhook_id}")
def change(webhook_id: Id, form: WebhookPatch, ctx: Audited, _: Admin) -> Webhook:
    """Change where it goes, what it is for, or whether it is sent at all."""
    values: dict[str, Any] = form.model_dump(exclude_unset=True)
    if "locations" in values:
        values["scope"] = Scope.of(values.pop("locations"))
    return webhook_view(webhooks.change_webhook(ctx, webhook_id, values))


@router.delete("/{webhook_id}", status_code=204)
def delete(webhook_id: Id, ctx: Audited, _: Admin) -> None:
    """Send nothing more, and forget its deliveries."""
    webhooks.delete_webhook(ctx, webhook_id)


@router.post("/{webhook_id}/test")
async def test(webhook_id: Id, ctx: Ctx, _: Admin) -> WebhookTest:
    """Send a signed message of type `test` now; what came of it."""
    webhook = await run_in_threadpool(webhooks.get_webhook, ctx, webhook_id)
    attempt = await send_test(ctx, webhook)
    return WebhookTest(delivered=attempt.delivered, **asdict(attempt))


@router.get("/{webhook_id}/deliveries")
def list_deliveries(
    webhook_id: Id, ctx: Ctx, _: Admin, state: State = None, limit: Limit = 100, after: After = None
) -> Page[Delivery]:
    """What was sent and what is to be, newest first."""
    found = webhooks.list_deliveries(ctx, webhook_id, state, cursor("after", after), limit + 1)
    items = [delivery_view(each) for each in found]
    return Page(items=items[:limit], next=str(items[limit - 1].id) if len(items) > limit else None)


@router.post("/{webhook_id}/deliveries/{delivery_id}/retry")
def retry(webhook_id: Id, delivery_id: Id, ctx: Audited, _: Admin) -> Delivery:
    """Try a delivery again at once, under the same `message_id`."""
    return delivery_view(webhooks.retry_delivery(ctx, webhook_id, delivery_id))
