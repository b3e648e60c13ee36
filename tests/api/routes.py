"""Every route of the API and who may use it, and requests to them."""

from typing import Any

from tests.api.house import NOW, Api

ROLES = ("robot", "operator", "admin")
LOCATION = {"interval_s": 3600}

# method, path, form, roles that may; as API.md has it: robots post, operators read, acknowledge and update.
TABLE: list[tuple[str, str, Any, set[str]]] = [
    ("POST", "/locations", {"name": "new-{role}", **LOCATION}, {"admin"}),
    ("GET", "/locations", None, {"operator", "admin"}),
    ("GET", "/locations/door", None, {"operator", "admin"}),
    ("PATCH", "/locations/door", {"confidence": 0.8}, {"admin"}),
    ("DELETE", "/locations/spare-{role}", None, {"admin"}),
    ("POST", "/locations/door/observations", {"time": [NOW - 60], "state": [1]}, {"robot", "admin"}),
    ("DELETE", "/locations/door/observations?start=0&stop=60", None, {"admin"}),
    ("POST", "/locations/door/scans", {"time": NOW - 60}, {"robot", "admin"}),
    ("GET", "/locations/door/scans", None, {"operator", "admin"}),
    ("GET", "/locations/door/scans/1/points", None, {"operator", "admin"}),
    ("POST", "/locations/door/scans/1/replay", None, {"operator", "admin"}),
    ("DELETE", "/locations/door/scans/1", None, {"operator", "admin"}),
    ("POST", "/locations/door/update?wait=30", {}, {"operator", "admin"}),
    ("GET", "/locations/door/state", None, {"operator", "admin"}),
    ("POST", "/locations/door/predict", {"time": [NOW]}, {"operator", "admin"}),
    ("GET", "/locations/door/series", None, {"operator", "admin"}),
    ("GET", "/locations/door/density", None, {"operator", "admin"}),
    ("GET", "/locations/door/information?best=1", None, {"operator", "admin"}),
    ("GET", "/locations/door/export?format=npz", None, {"operator", "admin"}),
    ("GET", "/locations/door/model", None, {"operator", "admin"}),
    ("POST", "/locations/door/evaluate", {"orders": [1]}, {"operator", "admin"}),
    ("GET", "/anomalies", None, {"operator", "admin"}),
    ("GET", "/locations/door/anomalies", None, {"operator", "admin"}),
    ("POST", "/locations/door/anomalies/detect", {"start": 0, "stop": NOW}, {"operator", "admin"}),
    ("GET", "/locations/door/confidence", None, {"operator", "admin"}),
    ("GET", "/anomalies/1", None, {"operator", "admin"}),
    ("POST", "/anomalies/1/acknowledge", {}, {"operator", "admin"}),
    ("POST", "/anomalies/1/snooze", {"until": None}, {"operator", "admin"}),
    ("GET", "/mutes", None, {"operator", "admin"}),
    ("POST", "/mutes", {"start": 0, "stop": 60, "locations": ["door"]}, {"operator", "admin"}),
    ("DELETE", "/mutes/999", None, {"operator", "admin"}),
    ("GET", "/jobs", None, {"operator", "admin"}),
    ("GET", "/jobs/1", None, {"operator", "admin"}),
    ("DELETE", "/jobs/1", None, {"operator", "admin"}),
    ("GET", "/events?kind=nothing", None, {"operator", "admin"}),
    ("GET", "/keys", None, {"admin"}),
    ("POST", "/keys", {"name": "another", "role": "robot"}, {"admin"}),
    ("POST", "/keys/999/rotate", {}, {"admin"}),
    ("DELETE", "/keys/999", None, {"admin"}),
    ("GET", "/audit", None, {"admin"}),
    ("GET", "/webhooks", None, {"admin"}),
    ("POST", "/webhooks", {"url": "https://alarms.example.org/{role}"}, {"admin"}),
    ("GET", "/webhooks/999", None, {"admin"}),
    ("PATCH", "/webhooks/999", {"enabled": True}, {"admin"}),
    ("DELETE", "/webhooks/999", None, {"admin"}),
    ("POST", "/webhooks/999/test", None, {"admin"}),
    ("GET", "/webhooks/999/deliveries", None, {"admin"}),
    ("POST", "/webhooks/999/deliveries/1/retry", None, {"admin"}),
]
IDS = [f"{method} {path}" for method, path, _, _ in TABLE]


def bearer(secret: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {secret}"}


def ask(api: Api, method: str, path: str, form: Any, role: str, **how: Any) -> Any:
    body = (
        {} if form is None else {"json": {k: str(v).format(role=role) if k == "name" else v for k, v in form.items()}}
    )
    return api.request(method, path.format(role=role), **body, **how)
