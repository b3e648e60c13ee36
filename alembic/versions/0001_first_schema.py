"""first schema

Revision: 0001
Revises:
"""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

BigInt = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.create_table(
        "api_key",
        sa.Column("id", BigInt, autoincrement=True, nullable=False),
        sa.Column("name", sa.String(length=128), nullable=False),
        sa.Column("role", sa.String(length=16), nullable=False),
        sa.Column("prefix", sa.String(length=16), nullable=False),
        sa.Column("hash", sa.LargeBinary(), nullable=False),
        sa.Column("created_at", sa.Float(precision=53), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_api_key")),
        sa.UniqueConstraint("hash", name=op.f("uq_api_key_hash")),
    )
    op.create_table(
        "counter",
        sa.Column("name", sa.String(length=32), nullable=False),
        sa.Column("value", BigInt, nullable=False),
        sa.PrimaryKeyConstraint("name", name=op.f("pk_counter")),
    )
    op.create_table(
        "location",
        sa.Column("id", BigInt, autoincrement=True, nullable=False),
        sa.Column("name", sa.String(length=128), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("interval_s", sa.Float(precision=53), nullable=False),
        sa.Column("time_zone", sa.String(length=64), nullable=False),
        sa.Column("epoch", sa.Float(precision=53), nullable=False),
        sa.Column("grid", sa.Text(), nullable=True),
        sa.Column("estimator", sa.String(length=16), nullable=False),
        sa.Column("order", sa.Integer(), nullable=True),
        sa.Column("confidence", sa.Float(precision=53), nullable=False),
        sa.Column("missing", sa.String(length=8), nullable=False),
        sa.Column("hold_s", sa.Float(precision=53), nullable=True),
        sa.Column("retention_s", sa.Float(precision=53), nullable=True),
        sa.Column("min_cells", sa.Integer(), nullable=False),
        sa.Column("created_at", sa.Float(precision=53), nullable=False),
        sa.Column("observation_seq", BigInt, nullable=False),
        sa.Column("compacted_seq", BigInt, nullable=False),
        sa.Column("measurements", BigInt, nullable=False),
        sa.Column("first_time", sa.Float(precision=53), nullable=True),
        sa.Column("last_time", sa.Float(precision=53), nullable=True),
        sa.Column("revision", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_location")),
        sa.UniqueConstraint("name", name=op.f("uq_location_name")),
    )
    op.create_table(
        "anomaly",
        sa.Column("location_id", BigInt, nullable=False),
        sa.Column("id", BigInt, autoincrement=False, nullable=False),
        sa.Column("start", sa.Float(precision=53), nullable=False),
        sa.Column("stop", sa.Float(precision=53), nullable=False),
        sa.Column("cells", sa.LargeBinary(), nullable=False),
        sa.Column("observed", sa.Integer(), nullable=False),
        sa.Column("probability", sa.Float(precision=53), nullable=False),
        sa.Column("surprise", sa.Float(precision=53), nullable=False),
        sa.Column("confidence", sa.Float(precision=53), nullable=False),
        sa.Column("rule", sa.String(length=16), nullable=False),
        sa.Column("revision", sa.Integer(), nullable=False),
        sa.Column("acknowledged", sa.Boolean(), nullable=False),
        sa.Column("acknowledged_by", sa.String(length=128), nullable=True),
        sa.Column("acknowledged_at", sa.Float(precision=53), nullable=True),
        sa.Column("note", sa.Text(), nullable=True),
        sa.ForeignKeyConstraint(
            ["location_id"], ["location.id"], name=op.f("fk_anomaly_location_id_location"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("location_id", "id", name=op.f("pk_anomaly")),
    )
    with op.batch_alter_table("anomaly", schema=None) as batch_op:
        batch_op.create_index("ix_anomaly_id", ["id"], unique=True)
        batch_op.create_index("ix_anomaly_open", ["location_id", "acknowledged"], unique=False)

    op.create_table(
        "history",
        sa.Column("location_id", BigInt, nullable=False),
        sa.Column("chunk", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("segment", BigInt, autoincrement=False, nullable=False),
        sa.Column("payload", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(
            ["location_id"], ["location.id"], name=op.f("fk_history_location_id_location"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("location_id", "chunk", "segment", name=op.f("pk_history")),
    )
    op.create_table(
        "job",
        sa.Column("location_id", BigInt, nullable=False),
        sa.Column("id", BigInt, autoincrement=False, nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("progress", sa.Float(precision=53), nullable=False),
        sa.Column("request", sa.Text(), nullable=False),
        sa.Column("error", sa.Text(), nullable=True),
        sa.Column("result", sa.LargeBinary(), nullable=True),
        sa.Column("created_at", sa.Float(precision=53), nullable=False),
        sa.Column("finished_at", sa.Float(precision=53), nullable=True),
        sa.ForeignKeyConstraint(
            ["location_id"], ["location.id"], name=op.f("fk_job_location_id_location"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("location_id", "id", name=op.f("pk_job")),
    )
    with op.batch_alter_table("job", schema=None) as batch_op:
        batch_op.create_index("ix_job_id", ["id"], unique=True)
        batch_op.create_index("ix_job_state", ["state"], unique=False)

    op.create_table(
        "observation",
        sa.Column("location_id", BigInt, nullable=False),
        sa.Column("id", BigInt, autoincrement=False, nullable=False),
        sa.Column("received_at", sa.Float(precision=53), nullable=False),
        sa.Column("source", sa.String(length=128), nullable=True),
        sa.Column("measurements", BigInt, nullable=False),
        sa.Column("first_time", sa.Float(precision=53), nullable=False),
        sa.Column("last_time", sa.Float(precision=53), nullable=False),
        sa.Column("idempotency_key", sa.String(length=255), nullable=True),
        sa.Column("body_hash", sa.LargeBinary(), nullable=True),
        sa.Column("payload", sa.LargeBinary(), nullable=True),
        sa.ForeignKeyConstraint(
            ["location_id"], ["location.id"], name=op.f("fk_observation_location_id_location"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("location_id", "id", name=op.f("pk_observation")),
    )
    with op.batch_alter_table("observation", schema=None) as batch_op:
        batch_op.create_index("ix_observation_idempotency", ["location_id", "idempotency_key"], unique=True)

    op.create_table(
        "revision",
        sa.Column("location_id", BigInt, nullable=False),
        sa.Column("revision", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("recipe", sa.LargeBinary(), nullable=False),
        sa.Column("start", BigInt, nullable=False),
        sa.Column("stop", BigInt, nullable=False),
        sa.Column("observation_seq", BigInt, nullable=False),
        sa.Column("measurements", BigInt, nullable=False),
        sa.Column("accuracy", sa.Float(precision=53), nullable=True),
        sa.Column("updated_at", sa.Float(precision=53), nullable=False),
        sa.Column("selection", sa.LargeBinary(), nullable=True),
        sa.ForeignKeyConstraint(
            ["location_id"], ["location.id"], name=op.f("fk_revision_location_id_location"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("location_id", "revision", name=op.f("pk_revision")),
    )
    op.create_table(
        "spectrum",
        sa.Column("location_id", BigInt, nullable=False),
        sa.Column("revision", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("chunk", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("payload", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(
            ["location_id"], ["location.id"], name=op.f("fk_spectrum_location_id_location"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("location_id", "revision", "chunk", name=op.f("pk_spectrum")),
    )


def downgrade() -> None:
    op.drop_table("spectrum")
    op.drop_table("revision")
    with op.batch_alter_table("observation", schema=None) as batch_op:
        batch_op.drop_index("ix_observation_idempotency")

    op.drop_table("observation")
    with op.batch_alter_table("job", schema=None) as batch_op:
        batch_op.drop_index("ix_job_state")
        batch_op.drop_index("ix_job_id")

    op.drop_table("job")
    op.drop_table("history")
    with op.batch_alter_table("anomaly", schema=None) as batch_op:
        batch_op.drop_index("ix_anomaly_open")
        batch_op.drop_index("ix_anomaly_id")

    op.drop_table("anomaly")
    op.drop_table("location")
    op.drop_table("counter")
    op.drop_table("api_key")
