"""how measurements of a sample combine, and what is deleted

Revision: 0003
Revises: 0002
"""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

BigInt = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
# The source of measurements whose robot the log does not name any more.
UNNAMED = """
INSERT INTO source (location_id, name, first_time, last_time)
SELECT id, '*', first_time, last_time FROM location
WHERE compacted_seq > 0 AND first_time IS NOT NULL AND last_time IS NOT NULL
AND NOT EXISTS (SELECT 1 FROM observation WHERE observation.location_id = location.id AND observation.id = 1)
"""


def upgrade() -> None:
    # Not as a batch: SQLite would make the table anew, and drop with the old one all that belongs to its rows.
    op.add_column("location", sa.Column("combine", sa.String(length=8), nullable=False, server_default="latest"))
    op.add_column("location", sa.Column("deleted", BigInt, nullable=False, server_default="0"))
    op.create_table(
        "source",
        sa.Column("location_id", BigInt, nullable=False),
        sa.Column("name", sa.String(length=128), nullable=False),
        sa.Column("first_time", sa.Float(precision=53), nullable=False),
        sa.Column("last_time", sa.Float(precision=53), nullable=False),
        sa.ForeignKeyConstraint(
            ["location_id"], ["location.id"], name=op.f("fk_source_location_id_location"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("location_id", "name", name=op.f("pk_source")),
        sqlite_with_rowid=False,
    )
    op.execute(UNNAMED)


def downgrade() -> None:
    op.drop_table("source")
    op.drop_column("location", "deleted")
    op.drop_column("location", "combine")
