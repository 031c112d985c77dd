"""`headland token`: who may read, control or administer a service."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.commands.serve import Data, DatabaseOption, settings_of

if TYPE_CHECKING:
    from contextlib import AbstractContextManager
    from pathlib import Path

    from planner.service.store import Store

token = typer.Typer(
    help="Tokens for the service: who may read, control or administer it.\n\n"
    "Example: headland token new --scope control --name office",
    no_args_is_help=True,
)


@token.callback()
def about() -> None:
    """Tokens for the service: who may read, control or administer it."""


@token.command()
def new(
    scope: Annotated[str, typer.Option(help="read, control (which includes read) or admin (which includes both).")],
    name: Annotated[Optional[str], typer.Option(help="What it is called; by default its scope and a number.")] = None,  # noqa: UP045
    data: Data = None,
    database: DatabaseOption = "",
) -> None:
    """Make a token and print it; it is shown this once and kept nowhere.

    Example: headland token new --scope control --name office
    """
    with _store(data, database) as store:
        text = store.new_token(name or _free_name(store, scope), scope)
    typer.echo(text)
    typer.echo("Keep it: it is shown this once. Whoever has it may do what its scope says.", err=True)


@token.command(name="list")
def list_all(data: Data = None, database: DatabaseOption = "") -> None:
    """List tokens by name: scope and when they were made.

    Example: headland token list
    """
    with _store(data, database) as store:
        rows = store.tokens()
    for row in rows:
        typer.echo(f"{row.name}  {row.scope}  {row.created}")


@token.command()
def revoke(
    name: Annotated[str, typer.Argument(help="The name of the token.")],
    data: Data = None,
    database: DatabaseOption = "",
) -> None:
    """Take a token back: from now on it is worth nothing.

    Example: headland token revoke office
    """
    with _store(data, database) as store:
        store.revoke_token(name)
    typer.echo(f"The token {name} is worth nothing any more.")


def _store(data: Path | None, database: str) -> AbstractContextManager[Store]:
    from planner.service.store import opened

    return opened(settings_of(data, database))


def _free_name(store: Store, scope: str) -> str:
    """A name that no token has: read-1, read-2 and so on."""
    taken = {row.name for row in store.tokens()}
    number = 1
    while f"{scope}-{number}" in taken:
        number += 1
    return f"{scope}-{number}"
