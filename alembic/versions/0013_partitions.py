"""partitions by location of what grows, ids that no index holds to be unique across them, and revisions with gaps

Revision: 0013
Revises: 0012
"""

import sqlalchemy as sa
from alembic import op

from tidemap.storage.partitions import has_locations, partition, unpartitioned

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # An index of a partitioned table can be unique only with its `location_id`. The counter that an id is taken from
    # stays locked until it is stored, so that no two are alike without that.
    for table in ("anomaly", "job"):
        op.drop_index(f"ix_{table}_id", table)
        op.create_index(f"ix_{table}_id", table, ["id"])
    # The chunks that a revision has a spectrum of, where it is not all: only of locations that were too large before.
    op.add_column("revision", sa.Column("chunks", sa.LargeBinary()))
    connection = op.get_bind()
    # A database that is in use waits for `tidemap migrate --partition`, as its tables are copied.
    if connection.dialect.name == "postgresql" and not has_locations(connection):
        for table in unpartitioned(connection):
            partition(connection, table)


def downgrade() -> None:
    # Partitions stay: the version before reads and writes them as well, and takes its ids from the same counters.
    op.drop_column("revision", "chunks")
