"""The client of a Tidemap server. It needs no part of the server installed.

    from tidemap import Client

    with Client("http://127.0.0.1:8000", key="tm_...") as tidemap:
        door = tidemap.create_location("office-door", interval_s=60, time_zone="Europe/London")
        door.observe(time=times, state=states)
        door.update(wait=True)
        door.predict(time=tomorrow_9am).probability

`AsyncClient` has the same operations, awaited.

A robot that is not always in range gives its client an outbox, a file on its own disk. What it observes is then kept
there, however the robot ends, until the server has stored it, once:

    with Client("http://127.0.0.1:8000", key="tm_...", outbox="/var/lib/robot/outbox.db") as tidemap:
        tidemap.location("office-door").observe(time=times, state=states)    # Queued(batches=1, measurements=...)
        tidemap.outbox.pending                                               # Pending(batches=1, bytes=..., ...)
        tidemap.outbox.flush(10)                                             # True: everything was sent
        tidemap.outbox.refused()                                             # what the server does not want, and why
"""

from tidemap.client.answers import UNKNOWN, Information, MapFile, Prediction, Series, State
from tidemap.client.asynchronous import AsyncClient, AsyncLocationHandle
from tidemap.client.blocking import Client, LocationHandle
from tidemap.client.errors import OutboxError, OutboxFullError, TidemapError, UnreachableError
from tidemap.client.feed import Message
from tidemap.client.outbox import AsyncOutbox, Outbox, Pending, Refused
from tidemap.client.posting import Queued
from tidemap.client.retry import RetryPolicy

__all__ = [
    "UNKNOWN",
    "AsyncClient",
    "AsyncLocationHandle",
    "AsyncOutbox",
    "Client",
    "Information",
    "LocationHandle",
    "MapFile",
    "Message",
    "Outbox",
    "OutboxError",
    "OutboxFullError",
    "Pending",
    "Prediction",
    "Queued",
    "Refused",
    "RetryPolicy",
    "Series",
    "State",
    "TidemapError",
    "UnreachableError",
]
