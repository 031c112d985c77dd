"""How Alembic runs the migrations: on the connection that planner.service.store.database hands it."""

from alembic import context

from planner.service.store.tables import TableBase

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=TableBase.metadata,
    render_as_batch=True,
    compare_type=True,
)
with context.begin_transaction():
    context.run_migrations()
