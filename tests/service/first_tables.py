"""The tables of the first version, with which the databases of that version were made."""

import sqlalchemy as sa

from planner.service.store.tables import NAMING_CONVENTION

NAME, SHA, TIME, KIND = sa.String(120), sa.String(64), sa.String(32), sa.String(16)
FIRST_TABLES = sa.MetaData(naming_convention=NAMING_CONVENTION)

sa.Table(
    "tokens",
    FIRST_TABLES,
    sa.Column("id", sa.Integer(), primary_key=True),
    sa.Column("name", NAME, nullable=False, unique=True),
    sa.Column("scope", KIND, nullable=False),
    sa.Column("sha256", SHA, nullable=False, unique=True),
    sa.Column("created", TIME, nullable=False),
)
sa.Table(
    "files",
    FIRST_TABLES,
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
sa.Table(
    "jobs",
    FIRST_TABLES,
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
    sa.Index("ix_jobs_status_tries_number", "status", "tries", "number"),
)
sa.Table(
    "results",
    FIRST_TABLES,
    sa.Column("id", sa.Integer(), primary_key=True),
    sa.Column("job", sa.Integer(), sa.ForeignKey("jobs.number", ondelete="CASCADE"), nullable=False),
    sa.Column("name", NAME, nullable=False),
    sa.Column("sha256", SHA, nullable=False),
    sa.Column("size", sa.Integer(), nullable=False),
    sa.Column("media", sa.String(80), nullable=False),
    sa.UniqueConstraint("job", "name"),
)
sa.Table(
    "fleets",
    FIRST_TABLES,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("name", NAME, nullable=False),
    sa.Column("plan", sa.Text(), nullable=False),
    sa.Column("settings", sa.JSON(), nullable=False),
    sa.Column("progress", sa.JSON(), nullable=False),
    sa.Column("created", TIME, nullable=False),
)
sa.Table(
    "recordings",
    FIRST_TABLES,
    sa.Column("id", sa.Integer(), primary_key=True),
    sa.Column("fleet", sa.String(32), sa.ForeignKey("fleets.id", ondelete="CASCADE"), nullable=False),
    sa.Column("tractor", sa.Integer(), nullable=False),
    sa.Column("rows", sa.LargeBinary(), nullable=False),
    sa.Index("ix_recordings_fleet_tractor", "fleet", "tractor"),
)
sa.Table(
    "events",
    FIRST_TABLES,
    sa.Column("id", sa.Integer(), primary_key=True),
    sa.Column("time", TIME, nullable=False),
    sa.Column("fleet", sa.String(32)),
    sa.Column("who", NAME, nullable=False),
    sa.Column("what", sa.String(200), nullable=False),
    sa.Column("data", sa.JSON(), nullable=False),
    sa.Index("ix_events_fleet_id", "fleet", "id"),
)
