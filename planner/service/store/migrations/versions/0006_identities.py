"""Tokens have identities that are never used again, by which files and jobs know their owners; writes are checked."""

from __future__ import annotations

import secrets

import sqlalchemy as sa
from alembic import op

from planner.service.store.database import draw_sqlite_mark

revision = "0006"
down_revision = "0005"

IDENTITY = sa.String(32)
OWNED_TABLES = ("files", "jobs")
TOKENS = sa.table("tokens", *map(sa.column, ("id", "name", "created", "identity")))


def upgrade() -> None:
    """What a token has made since it was there is its own; older things of its name are of a token that is gone."""
    op.create_table(
        "write_checks",
        sa.Column("id", sa.Integer(), primary_key=True),
        sa.Column("time", sa.String(32), nullable=False),
    )
    op.add_column("tokens", sa.Column("identity", IDENTITY))
    for name in OWNED_TABLES:
        op.add_column(name, sa.Column("owner_identity", IDENTITY))
    connection = op.get_bind()
    draw_sqlite_mark(connection)
    for token in connection.execute(sa.select(TOKENS.c.id, TOKENS.c.name, TOKENS.c.created)).all():
        identity = secrets.token_hex(16)
        connection.execute(sa.update(TOKENS).where(TOKENS.c.id == token.id).values(identity=identity))
        for name in OWNED_TABLES:
            table = sa.table(name, *map(sa.column, ("owner", "created", "owner_identity")))
            is_own = (table.c.owner == token.name) & (table.c.created >= token.created)
            connection.execute(sa.update(table).where(is_own).values(owner_identity=identity))
    with op.batch_alter_table("tokens") as batch:
        batch.alter_column("identity", existing_type=IDENTITY, nullable=False)
        batch.create_unique_constraint("uq_tokens_identity", ["identity"])
