"""Unit of work: all repositories on one connection, in one transaction that somebody else ends."""

from dataclasses import dataclass

from sqlalchemy import Connection

from tidemap.storage.fencing import FencingTokens
from tidemap.storage.repositories.anomalies import AnomalyRepository
from tidemap.storage.repositories.audit import AuditRepository
from tidemap.storage.repositories.jobs import JobRepository
from tidemap.storage.repositories.keys import KeyRepository
from tidemap.storage.repositories.locations import LocationRepository
from tidemap.storage.repositories.mutes import MuteRepository
from tidemap.storage.repositories.observations import ObservationRepository
from tidemap.storage.repositories.rhythms import RhythmRepository
from tidemap.storage.repositories.scans import ScanRepository
from tidemap.storage.repositories.segments import SegmentRepository
from tidemap.storage.repositories.sources import SourceRepository
from tidemap.storage.repositories.spectra import SpectrumRepository
from tidemap.storage.repositories.webhooks import WebhookRepository


@dataclass(frozen=True, slots=True)
class Work:
    """What one transaction can do."""

    locations: LocationRepository
    observations: ObservationRepository
    sources: SourceRepository
    segments: SegmentRepository
    spectra: SpectrumRepository
    anomalies: AnomalyRepository
    scans: ScanRepository
    jobs: JobRepository
    keys: KeyRepository
    audit: AuditRepository
    webhooks: WebhookRepository
    mutes: MuteRepository
    rhythms: RhythmRepository
    terms: FencingTokens

    @classmethod
    def on(cls, connection: Connection) -> "Work":
        """All repositories on this connection."""
        return cls(
            LocationRepository(connection),
            ObservationRepository(connection),
            SourceRepository(connection),
            SegmentRepository(connection),
            SpectrumRepository(connection),
            AnomalyRepository(connection),
            ScanRepository(connection),
            JobRepository(connection),
            KeyRepository(connection),
            AuditRepository(connection),
            WebhookRepository(connection),
            MuteRepository(connection),
            RhythmRepository(connection),
            FencingTokens(connection),
        )
