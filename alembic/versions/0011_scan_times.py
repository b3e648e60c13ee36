"""scans are found by their time

Revision: 0011
Revises: 0010
"""

from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_index("ix_scan_time", "scan", ["location_id", "time"])


def downgrade() -> None:
    op.drop_index("ix_scan_time", "scan")
