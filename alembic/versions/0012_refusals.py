"""whose posts were refused

Revision: 0012
Revises: 0011
"""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None

BigInt = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.create_table(
        "refusal",
        sa.Column("location_id", BigInt, nullable=False),
        sa.Column("name", sa.String(128), nullable=False),
        sa.Column("count", BigInt, nullable=False),
        sa.Column("since", sa.Float(53), nullable=False),
        sa.Column("last_at", sa.Float(53), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(
            ["location_id"], ["location.id"], name="fk_refusal_location_id_location", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("location_id", "name", name="pk_refusal"),
        sqlite_with_rowid=False,
    )


def downgrade() -> None:
    op.drop_table("refusal")
