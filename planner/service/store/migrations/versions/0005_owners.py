"""Files and jobs name the token that made them, and files the time of their last change."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"

COLUMNS = {
    "files": (("owner", sa.String(120)), ("changed", sa.String(32))),
    "jobs": (("owner", sa.String(120)),),
}


def upgrade() -> None:
    """What is there already belongs to nobody: every planner may change it, as before."""
    for table, columns in COLUMNS.items():
        for name, kind in columns:
            op.add_column(table, sa.Column(name, kind))
