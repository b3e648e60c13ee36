"""The client of a Tidemap server. It needs no part of the server installed.

    from app.client import Client

    with Client("http://127.0.0.1:8000", key="tm_...") as tidemap:
        door = tidemap.create_location("office-door", interval_s=60, time_zone="Europe/London")
        door.observe(time=times, state=states)
        door.update(wait=True)
        door.predict(time=tomorrow_9am).probability

`AsyncClient` has the same operations, awaited.
"""

from app.client.answers import UNKNOWN, Prediction, Series, State
from app.client.asynchronous import AsyncClient, AsyncLocationHandle
from app.client.blocking import Client, LocationHandle
from app.client.errors import TidemapError, UnreachableError
from app.client.feed import Message
from app.client.patience import Patience

__all__ = [
    "UNKNOWN",
    "AsyncClient",
    "AsyncLocationHandle",
    "Client",
    "LocationHandle",
    "Message",
    "Patience",
    "Prediction",
    "Series",
    "State",
    "TidemapError",
    "UnreachableError",
]
