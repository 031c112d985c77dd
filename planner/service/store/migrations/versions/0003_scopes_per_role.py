"""Tokens have scopes per role, may be bound to one tractor of one fleet, and may end."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Who could control may do what planners and operators do; who reads or administers does so as before."""
    with op.batch_alter_table("tokens") as table:
        table.alter_column(
            "scope", new_column_name="scopes", existing_type=sa.String(16), type_=sa.String(80), existing_nullable=False
        )
        table.add_column(sa.Column("fleet", sa.String(32)))
        table.add_column(sa.Column("tractor", sa.Integer()))
        table.add_column(sa.Column("expires", sa.String(32)))
    op.execute("UPDATE tokens SET scopes = 'operator planner' WHERE scopes = 'control'")
