"""Scans as the API shows them."""

from tidemap.api.views.observations import accepted_view
from tidemap.schemas.scans import Registration, ScanAccepted, ScanItem
from tidemap.services.posts import Observed
from tidemap.storage.records import ScanRecord


def scan_accepted_view(result: Observed) -> ScanAccepted:
    """The answer to a scan."""
    scan = result.scan
    return ScanAccepted(
        **dict(accepted_view(result)),
        scan=None if scan is None else scan.id,
        registration=None if scan is None else Registration.model_validate(scan.registration),
    )


def scan_view(record: ScanRecord) -> ScanItem:
    """One scan of a list."""
    return ScanItem(
        id=record.id,
        time=record.time,
        received_at=record.received_at,
        source=record.source,
        points=record.points,
        bytes=record.n_bytes,
        observation=record.observation,
        registration=Registration.model_validate(record.registration),
    )
