"""The first tables, with which every database of that version was made; those of today are made by their models."""

revision = "0001"
down_revision = None


def upgrade() -> None:
    """They are there: no database is older."""
