"""The outbox: what a robot observed, kept on its own disk until the server has it.

`observe` returns when the batches are durably in the file; a thread sends them, in order for each location, and
takes them out when the server has answered that they are stored. Whatever is killed, and when: what `observe`
returned for is stored exactly once, for each batch got its idempotency key before it got into the file. (A server
knows a key for 7 days at least. A robot that lost its answer and comes back later than that may repeat a batch.)

What the server refuses for good (a status 4xx that does not pass) is put aside with the server's words and blocks
nothing; see `refused`, `retry`, `move` and `discard`, or the command `tidemap outbox`. With everything else (no
connection, an overloaded or failing server, a key that is not valid or not for that location) it waits and tries again
for ever.

An outbox belongs to one server and one key. Several clients and processes may use one file at the same time: one of
them sends, and another takes over when it ends. A process that forks opens its client afterwards. The file lies on a
local disk, with two or three more beside it that have its name and `-wal`, `-shm` or `-sender` behind it; up to 10 MB
of the disk stay free for work on it.
"""

from tidemap.client.outbox.asynchronous import AsyncOutbox
from tidemap.client.outbox.blocking import Outbox, PathLike, open_outbox
from tidemap.client.outbox.store import Pending, Refused

__all__ = ["AsyncOutbox", "Outbox", "PathLike", "Pending", "Refused", "open_outbox"]
