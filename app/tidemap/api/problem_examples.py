"""One example of each kind of problem, made by the errors themselves, and which routes can answer with which."""

from collections.abc import Iterable, Mapping, Sequence
from http import HTTPStatus
from pathlib import Path
from typing import Any

from tidemap import errors
from tidemap.api.addresses import BASE
from tidemap.api.errors import STATUS, headers_of, look_up

_SAMPLES: tuple[errors.DomainError, ...] = (
    errors.UnreadableBodyError("The body is no JSON: unexpected end of data at byte 17."),
    errors.UnauthorizedError(
        "Send a key: 'Authorization: Bearer tm_…'. An admin makes keys with 'tidemap keys create'."
    ),
    errors.ForbiddenError("The key 'rover-7' has role robot; this needs operator or admin."),
    errors.OutOfScopeError("The key 'display of floor 2' is limited to other locations."),
    errors.OtherSiteError("A page at https://elsewhere.example may do nothing at map.example.com."),
    errors.LocationNotFoundError("office-door"),
    errors.CellNotFoundError(24_000, 24_000),
    errors.JobNotFoundError(17),
    errors.AnomalyNotFoundError(17),
    errors.ScanNotFoundError("lab", 17),
    errors.KeyNotFoundError(17),
    errors.MuteNotFoundError(17),
    errors.WebhookNotFoundError(17),
    errors.DeliveryNotFoundError(17),
    errors.BodyStalledError(30),
    errors.LocationExistsError("office-door"),
    errors.IdempotencyConflictError("c0ffee"),
    errors.NoModelError("office-door"),
    errors.TooManyWebhooksError(100),
    errors.TooManyMutesError(1000),
    errors.KeyEndsError(3),
    errors.SecretFileError(Path("secret.key"), "it holds no key of 32 bytes"),
    errors.JobFinishedError(17, "done"),
    errors.ScanSettledError(17, "accepted"),
    errors.BodyTooLargeError(16 * 2**20),
    errors.UnsupportedMediaTypeError("Content-Type 'text/csv' is not read here; send application/json."),
    errors.InvalidInputError.at("time[3]", "NaN and infinity are no times; give Unix seconds"),
    errors.RateLimitError(2),
    errors.CorruptChunkError("history of location 'lab', chunk 1, segment 0", "its checksum is wrong"),
    errors.ShuttingDownError(),
    errors.QueueFullError(),
    errors.TooManyBodiesError(),
    errors.KeyChangedError(),
    errors.StorageUnavailableError(),
)
SAMPLES: Mapping[str, errors.DomainError] = {each.code: each for each in _SAMPLES}
ALWAYS = (
    "unauthorized",
    "forbidden",
    "other-site",
    "invalid-input",
    "rate-limit",
    "shutting-down",
    "storage-unavailable",
)
FILTERED = {("get", "/locations"), ("get", "/anomalies"), ("get", "/jobs"), ("get", "/mutes"), ("post", "/mutes")}
"""Routes that show what is in the scope of a key, and refuse none for its scope."""
OWNED = {"anomaly_id", "job_id", "mute_id"}
"""What is not there for a key that may not see its location."""
WITH_BODY = ("unreadable-body", "body-stalled", "body-too-large", "unsupported-media-type", "too-many-bodies")
BY_PARAMETER = {
    "name": "location-not-found",
    "location": "location-not-found",
    "job_id": "job-not-found",
    "anomaly_id": "anomaly-not-found",
    "scan_id": "scan-not-found",
    "key_id": "key-not-found",
    "mute_id": "mute-not-found",
    "webhook_id": "webhook-not-found",
    "delivery_id": "delivery-not-found",
    "cell": "cell-not-found",
}
_HERE = "/locations/{name}"
_OF_MODEL = ("no-model", "corrupt-chunk")
BY_ROUTE: Mapping[tuple[str, str], Sequence[str]] = {
    ("post", "/locations"): ("name-taken",),
    ("patch", _HERE): ("name-taken",),
    ("post", f"{_HERE}/observations"): ("idempotency-key-reused", "key-changed"),
    ("delete", f"{_HERE}/observations"): ("corrupt-chunk",),
    ("post", f"{_HERE}/scans"): ("idempotency-key-reused", "key-changed"),
    ("get", f"{_HERE}/scans/{{scan_id}}/points"): ("scan-settled", "corrupt-chunk", "too-many-bodies"),
    ("post", f"{_HERE}/scans/{{scan_id}}/replay"): ("scan-settled", "corrupt-chunk", "too-many-bodies"),
    ("get", f"{_HERE}/state"): (*_OF_MODEL, "key-changed"),
    ("post", f"{_HERE}/predict"): (*_OF_MODEL, "cell-not-found"),
    ("get", f"{_HERE}/series"): _OF_MODEL,
    ("get", f"{_HERE}/information"): _OF_MODEL,
    ("get", f"{_HERE}/model"): _OF_MODEL,
    ("get", f"{_HERE}/export"): _OF_MODEL,
    ("get", f"{_HERE}/confidence"): _OF_MODEL,
    ("post", f"{_HERE}/evaluate"): _OF_MODEL,
    ("post", f"{_HERE}/anomalies/detect"): _OF_MODEL,
    ("delete", "/jobs/{job_id}"): ("job-finished",),
    ("post", "/keys/{key_id}/rotate"): ("key-ends",),
    ("post", "/mutes"): ("too-many-mutes", "out-of-scope"),
    ("post", "/webhooks"): ("too-many-webhooks", "secret-file"),
}


def codes_of(method: str, path: str, operation: Mapping[str, Any]) -> list[str]:
    """The kinds of problems that an operation of the document can answer with, in the order of SAMPLES."""
    parameters = {each["name"] for each in operation.get("parameters", ())}
    found = {*ALWAYS, *BY_ROUTE.get((method, path), ())}
    found |= {BY_PARAMETER[name] for name in parameters & BY_PARAMETER.keys()}
    if (method, path) not in FILTERED and not parameters & OWNED:
        found.add("out-of-scope")
    if method != "get":
        found.add("queue-full")
    if "requestBody" in operation:
        found |= set(WITH_BODY)
    return [code for code in SAMPLES if code in found]


def responses_of(codes: Iterable[str]) -> dict[str, Any]:
    """The responses of an operation that can answer with these kinds of problems, by status."""
    by_status: dict[int, list[errors.DomainError]] = {}
    for code in codes:
        by_status.setdefault(look_up(STATUS, SAMPLES[code], 500), []).append(SAMPLES[code])
    return {str(status): _response(status, samples) for status, samples in sorted(by_status.items())}


def _response(status: int, samples: Sequence[errors.DomainError]) -> dict[str, Any]:
    names = sorted({name for sample in samples for name in headers_of(sample)} - {"Connection"})
    answer: dict[str, Any] = {
        "description": ", or ".join(f"{sample.title} (`{sample.code}`)" for sample in samples),
        "content": {
            "application/problem+json": {
                "schema": {"$ref": "#/components/schemas/Problem"},
                "examples": {sample.code: {"value": _document(status, sample)} for sample in samples},
            }
        },
    }
    if names:
        answer["headers"] = {name: {"schema": {"type": "string"}} for name in names}
    return answer


def _document(status: int, sample: errors.DomainError) -> dict[str, Any]:
    shown: dict[str, Any] = {
        "type": f"urn:tidemap:problem:{sample.code}",
        "title": sample.title,
        "status": HTTPStatus(status).value,
        "detail": str(sample),
        "instance": f"{BASE}/locations/office-door",
    }
    if isinstance(sample, errors.InvalidInputError):
        shown["errors"] = [{"field": each.field, "message": each.message} for each in sample.errors]
    return shown
