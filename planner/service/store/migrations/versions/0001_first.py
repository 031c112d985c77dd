"""The first tables."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

NAME, SHA, TIME, KIND = sa.String(120), sa.String(64), sa.String(32), sa.String(16)


def upgrade() -> None:
    """Make the tables."""
    _create_access_tables()
    _create_job_tables()
    _create_fleet_tables()


def _create_access_tables() -> None:
    op.create_table(
        "tokens",
        sa.Column("id", sa.Integer(), primary_key=True),
        sa.Column("name", NAME, nullable=False, unique=True),
        sa.Column("scope", KIND, nullable=False),
        sa.Column("sha256", SHA, nullable=False, unique=True),
        sa.Column("created", TIME, nullable=False),
    )
    op.create_table(
        "files",
        sa.Column("id", sa.Integer(), primary_key=True),
        sa.Column("kind", KIND, nullable=False),
        sa.Column("name", NAME, nullable=False),
        sa.Column("suffix", KIND, nullable=False),
        sa.Column("sha256", SHA, nullable=False),
        sa.Column("size", sa.Integer(), nullable=False),
        sa.Column("media", sa.String(80), nullable=False),
        sa.Column("created", TIME, nullable=False),
        sa.UniqueConstraint("kind", "name"),
    )


def _create_job_tables() -> None:
    op.create_table(
        "jobs",
        sa.Column("number", sa.Integer(), primary_key=True),
        sa.Column("id", sa.String(32), nullable=False, unique=True),
        sa.Column("kind", KIND, nullable=False),
        sa.Column("name", NAME, nullable=False),
        sa.Column("status", KIND, nullable=False),
        sa.Column("request", sa.JSON(), nullable=False),
        sa.Column("work", sa.JSON(), nullable=False),
        sa.Column("inputs", sa.JSON(), nullable=False),
        sa.Column("done", sa.Integer(), nullable=False),
        sa.Column("all", sa.Integer(), nullable=False),
        sa.Column("words", sa.String(200), nullable=False),
        sa.Column("error", sa.Text()),
        sa.Column("created", TIME, nullable=False),
        sa.Column("finished", TIME),
        sa.Column("worker", sa.String(80)),
        sa.Column("lease", sa.Float()),
        sa.Column("tries", sa.Integer(), nullable=False),
    )
    op.create_index("ix_jobs_status_tries_number", "jobs", ["status", "tries", "number"])
    op.create_table(
        "results",
        sa.Column("id", sa.Integer(), primary_key=True),
        sa.Column("job", sa.Integer(), sa.ForeignKey("jobs.number", ondelete="CASCADE"), nullable=False),
        sa.Column("name", NAME, nullable=False),
        sa.Column("sha256", SHA, nullable=False),
        sa.Column("size", sa.Integer(), nullable=False),
        sa.Column("media", sa.String(80), nullable=False),
        sa.UniqueConstraint("job", "name"),
    )


def _create_fleet_tables() -> None:
    op.create_table(
        "fleets",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("name", NAME, nullable=False),
        sa.Column("plan", sa.Text(), nullable=False),
        sa.Column("settings", sa.JSON(), nullable=False),
        sa.Column("progress", sa.JSON(), nullable=False),
        sa.Column("created", TIME, nullable=False),
    )
    op.create_table(
        "recordings",
        sa.Column("id", sa.Integer(), primary_key=True),
        sa.Column("fleet", sa.String(32), sa.ForeignKey("fleets.id", ondelete="CASCADE"), nullable=False),
        sa.Column("tractor", sa.Integer(), nullable=False),
        sa.Column("rows", sa.LargeBinary(), nullable=False),
    )
    op.create_index("ix_recordings_fleet_tractor", "recordings", ["fleet", "tractor"])
    op.create_table(
        "events",
        sa.Column("id", sa.Integer(), primary_key=True),
        sa.Column("time", TIME, nullable=False),
        sa.Column("fleet", sa.String(32)),
        sa.Column("who", NAME, nullable=False),
        sa.Column("what", sa.String(200), nullable=False),
        sa.Column("data", sa.JSON(), nullable=False),
    )
    op.create_index("ix_events_fleet_id", "events", ["fleet", "id"])
