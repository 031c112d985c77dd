"""Results under way in a store, by their address."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    """What is under way is in the database."""
    op.add_column("job_bytes", sa.Column("address", sa.Text()))
