"""The tables of DESIGN section 3. Every primary key begins with `location_id`, the key of a later sharding."""

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
# `deleted` those of them that were deleted.
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
)

spectrum = Table(
    "spectrum",
    metadata,
    _location_id(),
    Column("revision", Integer, primary_key=True, autoincrement=False),
    Column("chunk", Integer, primary_key=True, autoincrement=False),
    Column("payload", LargeBinary, nullable=False),
)

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
    Index("ix_anomaly_id", "id", unique=True),
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
    Index("ix_job_id", "id", unique=True),
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

# Counters whose row lock makes ids grow in commit order, so that a reader's cursor never skips one.
counter = Table(
    "counter",
    metadata,
    Column("name", String(32), primary_key=True),
    Column("value", BigInt, nullable=False),
)
