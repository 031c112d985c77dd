"""How a file is to be read where it does not say so itself."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Files that are there say all themselves."""
    op.add_column("files", sa.Column("options", sa.JSON(), nullable=False, server_default=sa.text("'{}'")))
