"""whose public holidays a location has, and where it stands

Revision: 0009
Revises: 0004
"""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # Not as a batch: SQLite would make the table anew, and drop with the old one all that belongs to its rows.
    op.add_column("location", sa.Column("calendar", sa.String(length=8)))
    op.add_column("location", sa.Column("pose", sa.Text()))


def downgrade() -> None:
    op.drop_column("location", "pose")
    op.drop_column("location", "calendar")
