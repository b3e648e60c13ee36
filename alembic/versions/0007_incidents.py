"""events that grow, and how far what is held was judged

Revision: 0007
Revises: 0006
"""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

BigInt = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    # Not as a batch: SQLite would make the table anew, and drop with the old one all that belongs to its rows.
    op.add_column("location", sa.Column("event_gap_s", sa.Float(precision=53), nullable=True))
    op.add_column("location", sa.Column("judged_to", sa.Float(precision=53), nullable=True))
    op.add_column("anomaly", sa.Column("marks", BigInt, nullable=False, server_default="1"))
    op.add_column("anomaly", sa.Column("part_of", BigInt, nullable=True))
    op.create_index("ix_anomaly_stop", "anomaly", ["location_id", "stop", "start"])


def downgrade() -> None:
    op.drop_index("ix_anomaly_stop", "anomaly")
    for table, column in (
        ("anomaly", "part_of"),
        ("anomaly", "marks"),
        ("location", "judged_to"),
        ("location", "event_gap_s"),
    ):
        op.drop_column(table, column)
