"""Unit of work: all repositories on one connection, in one transaction that somebody else ends."""

from dataclasses import dataclass

from sqlalchemy import Connection

from tidemap.storage.fencing import FencingTokens
from tidemap.storage.repositories.anomalies import Anomalies
from tidemap.storage.repositories.jobs import Jobs
from tidemap.storage.repositories.keys import Keys
from tidemap.storage.repositories.locations import Locations
from tidemap.storage.repositories.observations import Observations
from tidemap.storage.repositories.segments import Segments
from tidemap.storage.repositories.spectra import Spectra


@dataclass(frozen=True, slots=True)
class Work:
    """What one transaction can do."""

    locations: Locations
    observations: Observations
    segments: Segments
    spectra: Spectra
    anomalies: Anomalies
    jobs: Jobs
    keys: Keys
    terms: FencingTokens

    @classmethod
    def on(cls, connection: Connection) -> "Work":
        """All repositories on this connection."""
        return cls(
            Locations(connection),
            Observations(connection),
            Segments(connection),
            Spectra(connection),
            Anomalies(connection),
            Jobs(connection),
            Keys(connection),
            FencingTokens(connection),
        )
