"""The tables of DESIGN section 3. Every key of what belongs to a location begins with `location_id`.

By that the tables that grow are partitioned on PostgreSQL, and all of them can be distributed. The ids of events and
jobs are taken from counters, so that no two are alike, though no index says so.
"""

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    false,
    true,
)

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(column_0_label)s",
        "uq": "uq_%(table_name)s_%(column_0_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
        "pk": "pk_%(table_name)s",
    }
)

BigInt = BigInteger().with_variant(Integer, "sqlite")


def _location_id() -> Column[int]:
    return Column("location_id", BigInt, ForeignKey("location.id", ondelete="CASCADE"), primary_key=True)


# One row a location. `observation_seq` numbers its observations in commit order; those up to `compacted_seq` are in
# `history`, later ones (the log's tail) still carry their payload. `measurements` counts all that were ever posted,
# `deleted` those of them that were deleted. What is held was judged up to `judged_to`.
location = Table(
    "location",
    metadata,
    Column("id", BigInt, primary_key=True, autoincrement=True),
    Column("name", String(128), nullable=False, unique=True),
    Column("kind", String(16), nullable=False),
    Column("interval_s", Float(53), nullable=False),
    Column("time_zone", String(64), nullable=False),
    Column("epoch", Float(53), nullable=False),
    Column("grid", Text),
    Column("estimator", String(16), nullable=False),
    Column("order", Integer),
    Column("confidence", Float(53), nullable=False),
    Column("missing", String(8), nullable=False),
    Column("hold_s", Float(53)),
    Column("combine", String(8), nullable=False, server_default="latest"),
    Column("retention_s", Float(53)),
    Column("min_cells", Integer, nullable=False),
    Column("sensor", Text),
    Column("event_gap_s", Float(53)),
    Column("calendar", String(8)),
    Column("pose", Text),
    Column("created_at", Float(53), nullable=False),
    Column("observation_seq", BigInt, nullable=False, default=0),
    Column("compacted_seq", BigInt, nullable=False, default=0),
    Column("measurements", BigInt, nullable=False, default=0),
    Column("deleted", BigInt, nullable=False, server_default="0"),
    Column("first_time", Float(53)),
    Column("last_time", Float(53)),
    Column("revision", Integer, nullable=False, default=0),
    Column("judged_to", Float(53)),
)

# The append-only log: one row a posted observation. The payload moves to `history` with the next compaction; the
# row stays for its idempotency key until that is pruned.
observation = Table(
    "observation",
    metadata,
    _location_id(),
    Column("id", BigInt, primary_key=True, autoincrement=False),
    Column("received_at", Float(53), nullable=False),
    Column("source", String(128)),
    Column("measurements", BigInt, nullable=False),
    Column("first_time", Float(53), nullable=False),
    Column("last_time", Float(53), nullable=False),
    Column("idempotency_key", String(255)),
    Column("body_hash", LargeBinary),
    Column("payload", LargeBinary),
    Index("ix_observation_idempotency", "location_id", "idempotency_key", unique=True),
)

# Who measured when, of the log that is pruned: its first and last time by source, '' of robots without a name.
source = Table(
    "source",
    metadata,
    _location_id(),
    Column("name", String(128), primary_key=True),
    Column("first_time", Float(53), nullable=False),
    Column("last_time", Float(53), nullable=False),
    sqlite_with_rowid=False,
)

# Whose posts were refused: `count` since a time, without a day between two of them, and what was wrong with the last.
refusal = Table(
    "refusal",
    metadata,
    _location_id(),
    Column("name", String(128), primary_key=True),
    Column("count", BigInt, nullable=False),
    Column("since", Float(53), nullable=False),
    Column("last_at", Float(53), nullable=False),
    Column("reason", Text, nullable=False),
    sqlite_with_rowid=False,
)

# What became of each scan; those in quarantine still carry their points, and their idempotency key, as no observation
# has it. `observation` is the number of the one that a scan became.
scan = Table(
    "scan",
    metadata,
    _location_id(),
    Column("id", BigInt, primary_key=True, autoincrement=False),
    Column("observation", BigInt),
    Column("time", Float(53), nullable=False),
    Column("received_at", Float(53), nullable=False),
    Column("source", String(128)),
    Column("verdict", String(16), nullable=False),
    Column("registration", LargeBinary, nullable=False),
    Column("points", BigInt, nullable=False),
    Column("idempotency_key", String(255)),
    Column("body_hash", LargeBinary),
    Column("n_bytes", BigInt, nullable=False),
    Column("payload", LargeBinary),
    Index("ix_scan_idempotency", "location_id", "idempotency_key", unique=True),
    Index("ix_scan_verdict", "location_id", "verdict"),
    Index("ix_scan_time", "location_id", "time"),
)

# Cell-major history: one row per chunk of cells and segment of samples.
history = Table(
    "history",
    metadata,
    _location_id(),
    Column("chunk", Integer, primary_key=True, autoincrement=False),
    Column("segment", BigInt, primary_key=True, autoincrement=False),
    Column("payload", LargeBinary, nullable=False),
)

# One row an update: what was fitted, over which window, how well.
revision = Table(
    "revision",
    metadata,
    _location_id(),
    Column("revision", Integer, primary_key=True, autoincrement=False),
    Column("recipe", LargeBinary, nullable=False),
    Column("start", BigInt, nullable=False),
    Column("stop", BigInt, nullable=False),
    Column("observation_seq", BigInt, nullable=False),
    Column("measurements", BigInt, nullable=False),
    Column("accuracy", Float(53)),
    Column("updated_at", Float(53), nullable=False),
    Column("selection", LargeBinary),
    Column("persistence", LargeBinary),
    Column("detector", LargeBinary),
    Column("chunks", LargeBinary),
)

spectrum = Table(
    "spectrum",
    metadata,
    _location_id(),
    Column("revision", Integer, primary_key=True, autoincrement=False),
    Column("chunk", Integer, primary_key=True, autoincrement=False),
    Column("payload", LargeBinary, nullable=False),
)

# One row an event, which grows as long as it lasts. One that was found to be a part of an older one stays, and says so.
# `change` is the number of its latest change, of the same count as the ids: who has heard of all up to a number hears
# of what has a higher one. Nobody hears of what is `muted`, as all of it lies in a time that was muted, or snoozed.
anomaly = Table(
    "anomaly",
    metadata,
    _location_id(),
    Column("id", BigInt, primary_key=True, autoincrement=False),
    Column("start", Float(53), nullable=False),
    Column("stop", Float(53), nullable=False),
    Column("cells", LargeBinary, nullable=False),
    Column("observed", Integer, nullable=False),
    Column("probability", Float(53), nullable=False),
    Column("surprise", Float(53), nullable=False),
    Column("confidence", Float(53), nullable=False),
    Column("rule", String(16), nullable=False),
    Column("revision", Integer, nullable=False),
    Column("acknowledged", Boolean, nullable=False, default=False),
    Column("acknowledged_by", String(128)),
    Column("acknowledged_at", Float(53)),
    Column("note", Text),
    Column("marks", BigInt, nullable=False, server_default="1"),
    Column("part_of", BigInt),
    Column("ended", Boolean, nullable=False, server_default=true()),
    Column("change", BigInt, nullable=False, server_default="0"),
    Column("muted", Boolean, nullable=False, server_default=false()),
    Column("snoozed_by", String(128)),
    Column("snoozed_until", Float(53)),
    Index("ix_anomaly_id", "id"),
    Index("ix_anomaly_change", "change"),
    Index("ix_anomaly_ended", "ended", "stop"),
    Index("ix_anomaly_stop", "location_id", "stop", "start"),
    Index("ix_anomaly_open", "location_id", "acknowledged"),
)

job = Table(
    "job",
    metadata,
    _location_id(),
    Column("id", BigInt, primary_key=True, autoincrement=False),
    Column("kind", String(16), nullable=False),
    Column("state", String(16), nullable=False),
    Column("progress", Float(53), nullable=False, default=0.0),
    Column("request", Text, nullable=False),
    Column("error", Text),
    Column("result", LargeBinary),
    Column("created_at", Float(53), nullable=False),
    Column("finished_at", Float(53)),
    Index("ix_job_id", "id"),
    Index("ix_job_state", "state"),
)

api_key = Table(
    "api_key",
    metadata,
    Column("id", BigInt, primary_key=True, autoincrement=True),
    Column("name", String(128), nullable=False),
    Column("role", String(16), nullable=False),
    Column("prefix", String(16), nullable=False),
    Column("hash", LargeBinary, nullable=False, unique=True),
    Column("created_at", Float(53), nullable=False),
    Column("locations", Text),
    Column("expires_at", Float(53)),
    Column("last_used_at", Float(53)),
    Column("rotated", Boolean, nullable=False, server_default=false()),
)

# Browsers that are signed in, by the hash of their cookie: who reads a copy of this table cannot make the cookie.
session = Table(
    "session",
    metadata,
    Column("hash", LargeBinary(32), primary_key=True),
    Column("key_id", BigInt, nullable=False),
    Column("expires_at", Float(53), nullable=False),
    Index("ix_session_key", "key_id"),
)

# Who changed what. `request` is the one that did; its entry is stored with the change.
audit = Table(
    "audit",
    metadata,
    Column("id", BigInt, primary_key=True, autoincrement=False),
    Column("request", String(32), nullable=False, unique=True),
    Column("time", Float(53), nullable=False),
    Column("actor", String(128), nullable=False),
    Column("key_id", BigInt),
    Column("action", String(64), nullable=False),
    Column("target", Text, nullable=False),
    Column("detail", Text),
)

# Who wants to be sent anomalies. `cursor` is the last change with a delivery. The signing secret is not stored: it is
# derived from `salt` with a key outside of the database; `fingerprint` is its hash.
webhook = Table(
    "webhook",
    metadata,
    Column("id", BigInt, primary_key=True, autoincrement=True),
    Column("url", Text, nullable=False),
    Column("description", String(128), nullable=False),
    Column("locations", Text),
    Column("enabled", Boolean, nullable=False),
    Column("salt", LargeBinary, nullable=False),
    Column("fingerprint", LargeBinary, nullable=False),
    Column("cursor", BigInt, nullable=False),
    Column("created_at", Float(53), nullable=False),
)

# One row a change of an anomaly and webhook: `state` is waiting, delivered or failed. `update`: of an anomaly that the
# webhook has had before.
delivery = Table(
    "delivery",
    metadata,
    Column("id", BigInt, primary_key=True, autoincrement=False),
    Column("webhook_id", BigInt, nullable=False),
    Column("anomaly_id", BigInt, nullable=False),
    Column("message_id", String(64), nullable=False),
    Column("state", String(16), nullable=False),
    Column("attempts", Integer, nullable=False),
    Column("next_at", Float(53), nullable=False),
    Column("status", Integer),
    Column("error", Text),
    Column("created_at", Float(53), nullable=False),
    Column("finished_at", Float(53)),
    Column("update", Boolean, nullable=False, server_default=false()),
    Index("ix_delivery_due", "webhook_id", "state", "next_at"),
    Index("ix_delivery_anomaly", "webhook_id", "anomaly_id"),
)

# When nobody is to hear of the events of some locations: from `start` to `stop`, or every week so until `until`.
mute = Table(
    "mute",
    metadata,
    Column("id", BigInt, primary_key=True, autoincrement=False),
    Column("locations", Text),
    Column("start", Float(53), nullable=False),
    Column("stop", Float(53), nullable=False),
    Column("weekly", Boolean, nullable=False),
    Column("until", Float(53)),
    Column("note", Text, nullable=False),
    Column("created_by", String(128), nullable=False),
    Column("created_at", Float(53), nullable=False),
)

# In which five minutes something was posted, by the server's clock, of observations up to number `through`; `silence`
# is the event of the silence that goes on.
rhythm = Table(
    "rhythm",
    metadata,
    _location_id(),
    Column("through", BigInt, nullable=False),
    Column("heard", LargeBinary, nullable=False),
    Column("last_heard", Float(53)),
    Column("silence", BigInt),
)

# Since when some server has listened without a break, and until when that is known: one row.
listening = Table(
    "listening",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("since", Float(53), nullable=False),
    Column("until", Float(53), nullable=False),
)

# Counters whose row lock makes ids grow in commit order, so that a reader's cursor never skips one.
counter = Table(
    "counter",
    metadata,
    Column("name", String(32), primary_key=True),
    Column("value", BigInt, nullable=False),
)
