"""Unit of work: all repositories on one connection, in one transaction that somebody else ends."""

from dataclasses import dataclass

from sqlalchemy import Connection

from tidemap.storage.anomalies import Anomalies
from tidemap.storage.jobs import Jobs
from tidemap.storage.keys import Keys
from tidemap.storage.locations import Locations
from tidemap.storage.observations import Observations
from tidemap.storage.segments import Segments
from tidemap.storage.spectra import Spectra
from tidemap.storage.terms import Terms


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
    terms: Terms

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
            Terms(connection),
        )
