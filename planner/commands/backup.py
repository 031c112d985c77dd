"""`headland backup` and `headland restore`: all that a service has in one file, and back."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner.commands.serve import Data, DatabaseOption, settings_of


def backup(
    file: Annotated[Path, typer.Argument(help="The file to write, such as farm.zip.")],
    data: Data = None,
    database: DatabaseOption = "",
    force: Annotated[bool, typer.Option("--force", help="Write over a file that is there.")] = False,
) -> None:
    """Write all that the service has into one file, while it runs or not; unpacked it is a folder for --data.

    Example: headland backup farm.zip
    """
    from planner.commands.outputs import check_outputs, spare
    from planner.service.store import opened
    from planner.service.store.backup import back_up

    check_outputs((file, ".zip"))
    spare(file, force)
    with opened(settings_of(data, database)) as store:
        count = back_up(store, file)
    typer.echo(f"{file} holds the database and {count} files; unpacked into an empty folder it is one for --data.")


def restore(
    file: Annotated[Path, typer.Argument(help="A file that headland backup made.")],
    data: Data = None,
    database: DatabaseOption = "",
) -> None:
    """Bring a backup back into an empty folder and database, SQLite or PostgreSQL, while no service has them.

    Example: headland restore farm.zip --data farm
    """
    from planner.service.store import opened
    from planner.service.store.holding import held
    from planner.service.store.restore import restore as bring_back

    settings = settings_of(data, database)
    with held(settings), opened(settings) as store:
        count = bring_back(store, file)
    typer.echo(f"The database and {count} files of {file} are in {settings.data}; headland serve goes on from there.")
