"""`headland gnss`: the table of GNSS errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

gnss = typer.Typer(
    help="GNSS errors: make a table from static fixes.\n\nExample: headland gnss fit fixes.csv",
    no_args_is_help=True,
)


@gnss.callback()
def about() -> None:
    """GNSS errors: make a table from static fixes, or look at the one that comes with Headland."""


@gnss.command()
def fit(
    fixes: Annotated[Path, typer.Argument(help="CSV of static fixes: x_m, y_m or longitude, latitude.")],
    output: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--output", "-o", help="Write the table here, not to the screen."),
    ] = None,
) -> None:
    """Make the table of errors from static fixes of a receiver (section 2.3.1).

    Example: headland gnss fit fixes.csv -o table.csv
    """
    from planner.commands.outputs import check_outputs, written
    from vehicle.gnss import load_fixes, make_table, table_text

    check_outputs((output, ""), reads={fixes: "the fixes"})
    table = make_table(*load_fixes(fixes))
    if output is None:
        typer.echo(table_text(table), nl=False)
        return
    with written([(output, table_text(table))]):
        typer.echo(f"{int(table[-1, 3])} fixes in {len(table)} cells of a millimetre; written to {output}.")


@gnss.command()
def default() -> None:
    """Print the table that comes with Headland: 8000 fixes made for an RTK receiver.

    Example: headland gnss default > table.csv
    """
    from vehicle.gnss import default_table, table_text

    typer.echo(table_text(default_table()), nl=False)
