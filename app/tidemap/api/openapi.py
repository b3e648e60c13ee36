"""The API's own document: what FastAPI knows of it, with names, headers, problems and examples added."""

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any

from fastapi import FastAPI
from fastapi.responses import JSONResponse

from tidemap.api.addresses import BASE
from tidemap.api.problem_examples import codes_of, responses_of
from tidemap.schemas.common import Problem
from tidemap.schemas.events import WireMessage
from tidemap.schemas.maps import EvaluateForm, PredictForm
from tidemap.schemas.observations import GridObservations, StateObservations
from tidemap.schemas.scans import RangesScan, ScanHeader

Document = dict[str, Any]
_OWN_FORMS = (
    StateObservations,
    GridObservations,
    ScanHeader,
    RangesScan,
    PredictForm,
    EvaluateForm,
    Problem,
    WireMessage,
)
"""Forms that routes read and write by themselves."""
_HERE = "/locations/{name}"
OPERATION_IDS = {
    ("get", "/locations"): "list_locations",
    ("post", "/locations"): "create_location",
    ("get", _HERE): "get_location",
    ("patch", _HERE): "change_location",
    ("delete", _HERE): "delete_location",
    ("post", f"{_HERE}/observations"): "post_observations",
    ("delete", f"{_HERE}/observations"): "delete_observations",
    ("get", f"{_HERE}/scans"): "list_scans",
    ("post", f"{_HERE}/scans"): "post_scan",
    ("get", f"{_HERE}/scans/{{scan_id}}/points"): "get_scan_points",
    ("post", f"{_HERE}/scans/{{scan_id}}/replay"): "replay_scan",
    ("delete", f"{_HERE}/scans/{{scan_id}}"): "delete_scan",
    ("get", f"{_HERE}/state"): "get_state",
    ("post", f"{_HERE}/predict"): "predict",
    ("get", f"{_HERE}/series"): "get_series",
    ("get", f"{_HERE}/density"): "get_density",
    ("get", f"{_HERE}/information"): "get_information",
    ("get", f"{_HERE}/model"): "get_model",
    ("post", f"{_HERE}/evaluate"): "evaluate",
    ("get", f"{_HERE}/export"): "export_map",
    ("get", f"{_HERE}/confidence"): "find_confidence",
    ("get", "/anomalies"): "list_anomalies",
    ("get", f"{_HERE}/anomalies"): "list_location_anomalies",
    ("post", f"{_HERE}/anomalies/detect"): "detect_anomalies",
    ("get", "/anomalies/{anomaly_id}"): "get_anomaly",
    ("post", "/anomalies/{anomaly_id}/acknowledge"): "acknowledge_anomaly",
    ("post", "/anomalies/{anomaly_id}/snooze"): "snooze_anomaly",
    ("get", "/mutes"): "list_mutes",
    ("post", "/mutes"): "create_mute",
    ("delete", "/mutes/{mute_id}"): "delete_mute",
    ("post", f"{_HERE}/update"): "update_location",
    ("get", "/jobs"): "list_jobs",
    ("get", "/jobs/{job_id}"): "get_job",
    ("delete", "/jobs/{job_id}"): "cancel_job",
    ("get", "/keys"): "list_keys",
    ("post", "/keys"): "create_key",
    ("post", "/keys/{key_id}/rotate"): "rotate_key",
    ("delete", "/keys/{key_id}"): "revoke_key",
    ("get", "/audit"): "list_audit_log",
    ("get", "/webhooks"): "list_webhooks",
    ("post", "/webhooks"): "create_webhook",
    ("get", "/webhooks/{webhook_id}"): "get_webhook",
    ("patch", "/webhooks/{webhook_id}"): "change_webhook",
    ("delete", "/webhooks/{webhook_id}"): "delete_webhook",
    ("post", "/webhooks/{webhook_id}/test"): "test_webhook",
    ("get", "/webhooks/{webhook_id}/deliveries"): "list_deliveries",
    ("post", "/webhooks/{webhook_id}/deliveries/{delivery_id}/retry"): "retry_delivery",
    ("get", "/events"): "listen_to_events",
    ("get", "/healthz"): "get_health",
    ("get", "/readyz"): "get_readiness",
    ("get", "/metrics"): "get_metrics",
}
WITH_ETAG = {
    ("get", f"{_HERE}/state"),
    ("get", f"{_HERE}/density"),
    ("get", "/anomalies"),
    ("get", f"{_HERE}/anomalies"),
}
HEADERS: dict[tuple[str, str], dict[str, tuple[tuple[str, ...], str]]] = {
    ("post", "/locations"): {"Location": (("201",), "The address of the location.")},
    ("post", f"{_HERE}/update"): {"Location": (("200", "202"), "The address of the job.")},
    ("get", f"{_HERE}/series"): {
        "Content-Disposition": (("200",), "The name of the file, of a table of CSV."),
        "Tidemap-Revision": (("200",), "The revision that a table of CSV is of."),
    },
    ("get", f"{_HERE}/state"): {"Tidemap-Revision": (("200",), "The revision that the answer is of.")},
}
"""By operation: headers of an answer, with the statuses that have them."""
_IF_NONE_MATCH = {
    "name": "If-None-Match",
    "in": "header",
    "required": False,
    "description": "The ETag of the answer that is known already: 304 while it is the current one.",
    "schema": {"type": "string"},
}
SOCKET = (
    "The same address as a WebSocket (`ws://…/api/v1/events?location=&kind=&after=`, the key in the header of the "
    "upgrade): a message of JSON text each, as in `WireMessage`; what a reader says is not listened to. The header "
    "Last-Event-ID of the upgrade's answer names the last change of an anomaly before. Closed with 1013 where the "
    "reader does not keep up (resume with `after`), with 4401 where the key or session has ended, with 1012 where the "
    "server stops; "
    "refused with a problem document as every request."
)


def complete(document: Document) -> Document:
    """FastAPI's document, completed in place."""
    for path, method, operation in _operations(document):
        operation["operationId"] = OPERATION_IDS.get((method, path), operation["operationId"])
        _add_headers(method, path, operation)
        if path not in ("/healthz", "/readyz", "/metrics"):
            _add_problems(method, path, operation)
            _add_example(operation)
    _describe_socket(document)
    _add_components(document)
    return document


def install(app: FastAPI) -> None:
    """Serve the document. It is made when it is asked for; FastAPI would make it on the loop, where others wait."""
    generate, lock, made = app.openapi, Lock(), Document()

    def document() -> Document:
        with lock:
            if not made:
                made.update(complete(generate()))
        return made

    app.openapi = document  # type: ignore[method-assign]

    @app.get(f"{BASE}/openapi.json", include_in_schema=False)
    def openapi() -> JSONResponse:
        return JSONResponse(document())


def _operations(document: Document) -> Iterator[tuple[str, str, Document]]:
    for path, item in document["paths"].items():
        for method, operation in item.items():
            yield path.removeprefix(BASE), method, operation


def _add_headers(method: str, path: str, operation: Document) -> None:
    described = HEADERS.get((method, path), {})
    if (method, path) in WITH_ETAG:
        operation.setdefault("parameters", []).append(_IF_NONE_MATCH)
        described = {**described, "ETag": (("200", "304"), "Changes with the answer.")}
    for name, (statuses, description) in described.items():
        for status in statuses:
            headers = operation["responses"][status].setdefault("headers", {})
            headers[name] = {"description": description, "schema": {"type": "string"}}


def _add_problems(method: str, path: str, operation: Document) -> None:
    kept = {status: answer for status, answer in operation["responses"].items() if status[0] in "123"}
    operation["responses"] = kept | responses_of(codes_of(method, path, operation))


def _add_example(operation: Document) -> None:
    """What a server has answered; `python -m docs.api_examples` asks it again."""
    for status, answer in operation["responses"].items():
        media = answer.get("content", {}).get("application/json")
        example = answer_examples().get(operation["operationId"])
        if status[0] == "2" and media is not None and example is not None:
            media["example"] = example


@cache
def answer_examples() -> Document:
    """By operation id."""
    found: Document = json.loads((Path(__file__).parent / "answer_examples.json").read_text("utf-8"))
    return found


def _describe_socket(document: Document) -> None:
    answers = document["paths"][f"{BASE}/events"]["get"]["responses"]
    message = {"schema": {"$ref": "#/components/schemas/WireMessage"}}
    answers["101"] = {"description": SOCKET, "content": {"application/json": message}}


def _add_components(document: Document) -> None:
    parts = document.setdefault("components", {})
    schemas = parts.setdefault("schemas", {})
    for unused in ("HTTPValidationError", "ValidationError"):
        schemas.pop(unused, None)
    for form in _OWN_FORMS:
        schema = form.model_json_schema(ref_template="#/components/schemas/{model}")
        schemas.update(schema.pop("$defs", {}))
        schemas[form.__name__] = schema
    parts["securitySchemes"] = {"key": {"type": "http", "scheme": "bearer", "bearerFormat": "tm_…"}}
    document["security"] = [{"key": []}, {}]
