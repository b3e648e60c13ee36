"""What can go wrong, in the words of the domain. These classes know no HTTP: `tidemap.api.errors` maps them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

MAX_ERRORS = 100
"""Fields that one error names; a body may have a million wrong ones."""


@dataclass(frozen=True, slots=True)
class FieldError:
    """One offending place in the input: `field` as the sender wrote it, `message` saying what to change."""

    field: str
    message: str


class DomainError(Exception):
    """Base of every expected error. `code` names the kind in `type` of a problem document."""

    code = "error"
    title = "Error"

    def __reduce__(self) -> tuple[Any, ...]:
        """For pickle, which would give `__init__` the message: errors come back from other processes too."""
        return _same, (type(self), self.args, self.__dict__)


def _same(kind: type[DomainError], args: tuple[Any, ...], state: dict[str, Any]) -> DomainError:
    """An error as it was, not made anew."""
    error = kind.__new__(kind, *args)
    error.args = args
    error.__dict__.update(state)
    return error


class NotFoundError(DomainError):
    """Something was asked for by a name or an id that nothing has."""

    code = "not-found"
    title = "Not found"


class LocationNotFoundError(NotFoundError):
    """No location has this name."""

    code = "location-not-found"
    title = "Location not found"

    def __init__(self, name: str) -> None:
        super().__init__(f"There is no location {name!r}. GET /locations lists the names; POST /locations makes one.")


class CellNotFoundError(NotFoundError):
    """A question names a cell outside the location's grid."""

    code = "cell-not-found"
    title = "Cell not found"

    def __init__(self, cell: object, n_cells: int) -> None:
        super().__init__(f"Cell {cell} is outside this location: its cells are 0 to {n_cells - 1}.")


class JobNotFoundError(NotFoundError):
    """No job has this id."""

    code = "job-not-found"
    title = "Job not found"

    def __init__(self, job_id: object) -> None:
        super().__init__(f"There is no job {job_id}. GET /jobs lists them.")


class AnomalyNotFoundError(NotFoundError):
    """No anomaly has this id."""

    code = "anomaly-not-found"
    title = "Anomaly not found"

    def __init__(self, anomaly_id: object) -> None:
        super().__init__(f"There is no anomaly {anomaly_id}. GET /anomalies lists them.")


class ScanNotFoundError(NotFoundError):
    """No scan of the location has this id."""

    code = "scan-not-found"
    title = "Scan not found"

    def __init__(self, name: str, scan_id: object) -> None:
        super().__init__(f"Location {name!r} has no scan {scan_id}. GET /locations/{name}/scans lists them.")


class KeyNotFoundError(NotFoundError):
    """No key has this id."""

    code = "key-not-found"
    title = "Key not found"

    def __init__(self, key_id: object) -> None:
        super().__init__(f"There is no key {key_id}. GET /keys lists them.")


class MuteNotFoundError(NotFoundError):
    """No mute has this id."""

    code = "mute-not-found"
    title = "Mute not found"

    def __init__(self, mute_id: object) -> None:
        super().__init__(f"There is no mute {mute_id}. GET /mutes lists them.")


class WebhookNotFoundError(NotFoundError):
    """No webhook has this id."""

    code = "webhook-not-found"
    title = "Webhook not found"

    def __init__(self, webhook_id: object) -> None:
        super().__init__(f"There is no webhook {webhook_id}. GET /webhooks lists them.")


class DeliveryNotFoundError(NotFoundError):
    """No delivery of a webhook has this id."""

    code = "delivery-not-found"
    title = "Delivery not found"

    def __init__(self, delivery_id: object) -> None:
        super().__init__(f"There is no delivery {delivery_id} of this webhook. GET its deliveries to list them.")


class ConflictError(DomainError):
    """The request is sound but does not fit what is stored."""

    code = "conflict"
    title = "Conflict"


class LocationExistsError(ConflictError):
    """The name of a new location is taken."""

    code = "name-taken"
    title = "Name taken"

    def __init__(self, name: str) -> None:
        super().__init__(f"A location {name!r} exists already. Choose another name, or PATCH or DELETE that one.")


class IdempotencyConflictError(ConflictError):
    """An idempotency key came back with another body."""

    code = "idempotency-key-reused"
    title = "Idempotency key reused"

    def __init__(self, key: str) -> None:
        super().__init__(
            f"Idempotency-Key {key!r} was used for another body at this location. "
            "Send a new key with new data; nothing was stored."
        )


class NoModelError(ConflictError):
    """The location has no revision yet."""

    code = "no-model"
    title = "No model yet"

    def __init__(self, name: str) -> None:
        super().__init__(
            f"Location {name!r} has no model yet: post observations, then POST /locations/{name}/update "
            "(or wait for the background updater)."
        )


class TooManyMutesError(ConflictError):
    """There are as many mutes as there may be."""

    code = "too-many-mutes"
    title = "Too many mutes"

    def __init__(self, most: int) -> None:
        super().__init__(f"There are {most} mutes, and there may be no more. Delete some that are over.")


class TooManyWebhooksError(ConflictError):
    """There are as many webhooks as there may be."""

    code = "too-many-webhooks"
    title = "Too many webhooks"

    def __init__(self, most: int) -> None:
        super().__init__(f"There are {most} webhooks already. Delete one that nobody needs.")


class KeyEndsError(ConflictError):
    """A key was rotated before, or expires within the overlap of its rotation."""

    code = "key-ends"
    title = "Key ends soon"

    def __init__(self, key_id: object) -> None:
        super().__init__(
            f"Key {key_id} was rotated before, or expires before the overlap is over, and a new key would expire with "
            "it. If it was rotated, rotate the key that was made then (GET /keys lists them), or make a new one; else "
            "give a shorter overlap."
        )


class SecretFileError(ConflictError):
    """The file with the key that signatures are made with cannot be used."""

    code = "secret-file"
    title = "No key to sign with"

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"Nothing can be signed with the key in {path.name} (TIDEMAP_SECRET_FILE): {why}.")


class DestinationError(DomainError):
    """A webhook may not be sent where its URL leads, or that is nowhere."""

    code = "destination"
    title = "No such destination"


class JobFinishedError(ConflictError):
    """A job that has ended cannot be cancelled."""

    code = "job-finished"
    title = "Job finished"

    def __init__(self, job_id: object, state: str) -> None:
        super().__init__(f"Job {job_id} is {state}: only a queued job can be cancelled.")


class ScanSettledError(ConflictError):
    """A scan that is in quarantine no more cannot be registered again."""

    code = "scan-settled"
    title = "Scan settled"

    def __init__(self, scan_id: object, verdict: str) -> None:
        super().__init__(f"Scan {scan_id} is {verdict}: only a scan in quarantine can be registered again.")


class UnreadableBodyError(DomainError):
    """The body cannot be parsed at all."""

    code = "unreadable-body"
    title = "Unreadable body"


class UnusableFileError(DomainError):
    """A file cannot be imported; nothing of it was stored."""

    code = "unusable-file"
    title = "Unusable file"

    def __init__(self, path: object, why: str) -> None:
        super().__init__(f"{path}: {why}")


class UnsupportedMediaTypeError(DomainError):
    """The body is of a kind this endpoint does not read."""

    code = "unsupported-media-type"
    title = "Unsupported media type"


class BodyTooLargeError(DomainError):
    """The (unpacked) body exceeds the limit."""

    code = "body-too-large"
    title = "Body too large"

    def __init__(self, limit: int) -> None:
        super().__init__(
            f"The body is larger than {limit} bytes (counted unpacked). Split it into several posts, "
            "or raise TIDEMAP_MAX_BODY_BYTES (for JSON: TIDEMAP_MAX_JSON_BYTES) on the server."
        )


class BodyStalledError(DomainError):
    """The sender stopped in the midst of a body."""

    code = "body-stalled"
    title = "Body stalled"

    def __init__(self, waited_s: float) -> None:
        super().__init__(
            f"Nothing more of the body came for {waited_s:.0f} seconds. Send it again; nothing was stored."
        )


class InvalidInputError(DomainError):
    """Readable but wrong. `errors` name the fields and say what to change."""

    code = "invalid-input"
    title = "Invalid input"

    def __init__(self, *errors: FieldError) -> None:
        shown = errors[:MAX_ERRORS]
        super().__init__("; ".join(f"{error.field}: {error.message}" for error in shown))
        self.errors = shown

    @classmethod
    def at(cls, field: str, message: str) -> "InvalidInputError":
        """The error of one field."""
        return cls(FieldError(field, message))


def refuse_reversed(start: float | None, stop: float | None) -> None:
    """Raise InvalidInputError for a range of times that stops before it starts."""
    if start is not None and stop is not None and stop < start:
        raise InvalidInputError.at("stop", "it lies before start; swap them")


class UnauthorizedError(DomainError):
    """No key, or none that is known."""

    code = "unauthorized"
    title = "Key needed"


class ForbiddenError(DomainError):
    """A known key whose role does not allow this."""

    code = "forbidden"
    title = "Not allowed"


class OutOfScopeError(ForbiddenError):
    """A known key that is limited to other locations."""

    code = "out-of-scope"
    title = "Another location"


class OtherSiteError(DomainError):
    """A page of another site asks in the name of the person who looks at it."""

    code = "other-site"
    title = "Another site"


class BusyError(DomainError):
    """The server cannot take this now; the same request may be sent again after `retry_after_s`."""

    code = "busy"
    title = "Busy"
    retry_after_s = 1


class RateLimitError(BusyError):
    """More requests than the limit, of one key or from one address."""

    code = "rate-limit"
    title = "Too many requests"

    def __init__(self, retry_after_s: int) -> None:
        super().__init__(
            f"Too many requests came in a short time. Send this again in {retry_after_s} s, and several measurements "
            "in one post; nothing was stored."
        )
        self.retry_after_s = retry_after_s


class TooManyTabsError(BusyError):
    """Another tab of the viewer than one key may have open."""

    def __init__(self, most: int) -> None:
        super().__init__(
            f"{most} tabs of the viewer are open with this key, and this server allows no more. Close one of them, and "
            "this one opens by itself; TIDEMAP_VIEWER_TABS sets how many there may be."
        )


class KeyChangedError(BusyError):
    """The key was changed between the first look at it and this request, and is valid."""

    code = "key-changed"
    title = "Key changed"

    def __init__(self) -> None:
        super().__init__("An admin has just changed this key. Send this again; nothing was stored.")


class AskerLeftError(DomainError):
    """The client has closed the connection; the work for its answer ended."""

    code = "asker-left"
    title = "Asker left"

    def __init__(self) -> None:
        super().__init__("The connection was closed before the answer was complete.")


class ShuttingDownError(BusyError):
    """The server is stopping and takes no more work."""

    code = "shutting-down"
    title = "Shutting down"
    retry_after_s = 5

    def __init__(self) -> None:
        super().__init__("The server is shutting down. Send this again in a few seconds; nothing was stored.")


class QueueFullError(BusyError):
    """The commit queue is full."""

    code = "queue-full"
    title = "Queue full"

    def __init__(self) -> None:
        super().__init__("The commit queue is full. Send this again in a second; nothing was stored.")


class TooManyBodiesError(BusyError):
    """The memory for bodies is taken by others."""

    code = "too-many-bodies"
    title = "Too many bodies"
    retry_after_s = 2

    def __init__(self) -> None:
        super().__init__(
            "Too many large bodies are being read. Send this again in a few seconds, or smaller posts; "
            "nothing was stored."
        )


class NotLeaderError(BusyError):
    """Another process does the background work now."""

    code = "not-leader"
    title = "Not the leader"

    def __init__(self) -> None:
        super().__init__("Another process on this database does the background work now; nothing was stored.")


class ClusterUnavailableError(BusyError):
    """The scheduler of the Dask cluster does not answer."""

    code = "cluster-unavailable"
    title = "Cluster unavailable"

    def __init__(self, address: str) -> None:
        super().__init__(
            f"The Dask scheduler at {address} does not answer. Updates wait for it; check TIDEMAP_DASK_SCHEDULER."
        )


class WorkersDiedError(DomainError):
    """Every worker of the Dask cluster that began a task died meanwhile."""

    code = "workers-died"
    title = "Workers died"

    def __init__(self, task: str, last_worker: str) -> None:
        super().__init__(
            f"Each worker of the Dask cluster that began {task} died before its end, the last one at {last_worker}. "
            "Nothing of this update is visible. Their logs say why; where their memory is too small, give them more or "
            "lower TIDEMAP_UPDATE_THREADS. Then update again."
        )


class CorruptChunkError(DomainError):
    """A stored blob fails its checksum or cannot be read."""

    code = "corrupt-chunk"
    title = "Corrupt chunk"

    def __init__(self, what: str, why: str) -> None:
        super().__init__(f"The stored {what} is corrupt: {why}. Restore it from a backup; the rest is readable.")
        self.what, self.why = what, why


class LaterFormatError(CorruptChunkError):
    """A stored blob is whole, and of a format that a later version writes."""

    def __init__(self, what: str, why: str) -> None:
        super().__init__(what, why)
        self.args = (f"A later version of Tidemap wrote the stored {what}: {why}. Run that version.",)


class SchemaVersionError(DomainError):
    """The database has a schema this version does not know."""

    code = "schema-version"
    title = "Unknown schema version"


class DatabaseUnusableError(DomainError):
    """There is no database at the address, or something else than one of ours."""

    code = "database-unusable"
    title = "Database unusable"


class BackupError(DomainError):
    """A backup was not made."""

    code = "backup"
    title = "No backup made"


class StorageUnavailableError(BusyError):
    """The database does not answer now, or not as it should."""

    code = "storage-unavailable"
    title = "Storage unavailable"
    retry_after_s = 2

    def __init__(self) -> None:
        super().__init__(
            "The database does not answer now. Send this again in a few seconds; "
            "with its Idempotency-Key a post is stored once, even if its answer got lost."
        )
