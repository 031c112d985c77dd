"""Bytes under way to workers on other machines and back, whose turn it is, and the version of the service."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    """Nobody has had a turn yet, and the service lends the files of waiting jobs when it starts."""
    op.create_table(
        "job_bytes",
        sa.Column("sha256", sa.String(64), primary_key=True),
        sa.Column("job", sa.Integer(), sa.ForeignKey("jobs.number", ondelete="CASCADE"), primary_key=True),
        sa.Column("content", sa.LargeBinary(), nullable=False),
    )
    op.create_table(
        "turns",
        sa.Column("owner_identity", sa.String(32), primary_key=True),
        sa.Column("turn", sa.Integer(), nullable=False),
    )
    op.add_column("write_checks", sa.Column("version", sa.String(80)))
