"""The audit log on the wire."""

from tidemap.schemas.common import Answer, TimeOut


class AuditItem(Answer):
    """Somebody changed something: `action` is method and route, `target` the address, `detail` what was sent."""

    id: int
    time: TimeOut
    actor: str
    key_id: int | None
    action: str
    target: str
    detail: str | None
