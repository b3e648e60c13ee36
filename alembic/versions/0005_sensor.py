"""sensors that err, and what an update learned of them

Revision: 0005
Revises: 0004
"""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # Not as a batch: SQLite would make the table anew, and drop with the old one all that belongs to its rows.
    op.add_column("location", sa.Column("sensor", sa.Text(), nullable=True))
    op.add_column("revision", sa.Column("detector", sa.LargeBinary(), nullable=True))


def downgrade() -> None:
    op.drop_column("revision", "detector")
    op.drop_column("location", "sensor")
