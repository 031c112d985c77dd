"""Stored options of files and stored requests of jobs use the names that the API has now."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"

NEW_NAMES = {
    "swap": "swap_axes",
    "before": "deadline",
    "draws": "samples",
    "prefer": "objective",
    "along": "guidance_line",
    "tracks_only": "no_headland",
}
FILES = sa.table("files", sa.column("id", sa.Integer()), sa.column("options", sa.JSON()))
JOBS = sa.table(
    "jobs", sa.column("number", sa.Integer()), sa.column("request", sa.JSON()), sa.column("work", sa.JSON())
)


def upgrade() -> None:
    """Rename the keys."""
    connection = op.get_bind()
    for table, key, columns in ((FILES, FILES.c.id, ("options",)), (JOBS, JOBS.c.number, ("request", "work"))):
        for row in connection.execute(sa.select(table)).mappings().all():
            renamed = {name: _rename(row[name]) for name in columns}
            if any(renamed[name] != row[name] for name in columns):
                connection.execute(sa.update(table).where(key == row[key.name]).values(**renamed))


def _rename(values: Any) -> Any:
    return {NEW_NAMES.get(key, key): value for key, value in values.items()} if isinstance(values, dict) else values
