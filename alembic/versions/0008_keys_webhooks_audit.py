"""keys limited to locations and in time; webhooks with their deliveries; who changed what

Revision: 0008
Revises: 0007
"""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

BigInt = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.add_column("api_key", sa.Column("locations", sa.Text(), nullable=True))
    op.add_column("api_key", sa.Column("expires_at", sa.Float(53), nullable=True))
    op.add_column("api_key", sa.Column("last_used_at", sa.Float(53), nullable=True))
    op.create_table(
        "audit",
        sa.Column("id", BigInt, autoincrement=False, nullable=False),
        sa.Column("request", sa.String(32), nullable=False),
        sa.Column("time", sa.Float(53), nullable=False),
        sa.Column("actor", sa.String(128), nullable=False),
        sa.Column("key_id", BigInt, nullable=True),
        sa.Column("action", sa.String(64), nullable=False),
        sa.Column("target", sa.Text(), nullable=False),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.PrimaryKeyConstraint("id", name="pk_audit"),
        sa.UniqueConstraint("request", name="uq_audit_request"),
    )
    op.create_table(
        "webhook",
        sa.Column("id", BigInt, autoincrement=True, nullable=False),
        sa.Column("url", sa.Text(), nullable=False),
        sa.Column("description", sa.String(128), nullable=False),
        sa.Column("locations", sa.Text(), nullable=True),
        sa.Column("enabled", sa.Boolean(), nullable=False),
        sa.Column("salt", sa.LargeBinary(), nullable=False),
        sa.Column("fingerprint", sa.LargeBinary(), nullable=False),
        sa.Column("cursor", BigInt, nullable=False),
        sa.Column("created_at", sa.Float(53), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_webhook"),
    )
    op.create_table(
        "delivery",
        sa.Column("id", BigInt, autoincrement=False, nullable=False),
        sa.Column("webhook_id", BigInt, nullable=False),
        sa.Column("anomaly_id", BigInt, nullable=False),
        sa.Column("message_id", sa.String(64), nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("attempts", sa.Integer(), nullable=False),
        sa.Column("next_at", sa.Float(53), nullable=False),
        sa.Column("status", sa.Integer(), nullable=True),
        sa.Column("error", sa.Text(), nullable=True),
        sa.Column("created_at", sa.Float(53), nullable=False),
        sa.Column("finished_at", sa.Float(53), nullable=True),
        sa.PrimaryKeyConstraint("id", name="pk_delivery"),
    )
    op.create_index("ix_delivery_due", "delivery", ["webhook_id", "state", "next_at"])


def downgrade() -> None:
    op.drop_table("delivery")
    op.drop_table("webhook")
    op.drop_table("audit")
    for name in ("last_used_at", "expires_at", "locations"):
        op.drop_column("api_key", name)
