"""`headland farm`: the farm file, made and checked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner.commands.options import AsJson

farm = typer.Typer(
    help="The farm file: tractors, implements, prices, times.\n\nExample: headland farm check farm.toml",
    no_args_is_help=True,
)


@farm.callback()
def about() -> None:
    """The farm file: what a farm has and pays, for `headland plan --farm`."""


@farm.command()
def new(
    file: Annotated[Path, typer.Argument(help="The file to write, such as farm.toml.")],
    force: Annotated[bool, typer.Option("--force", help="Write over a file that is there.")] = False,
) -> None:
    """Write an example of a farm file, to be changed to what a farm has.

    Example: headland farm new farm.toml
    """
    from planner.commands.outputs import check_outputs, spare, written
    from planner.farm import example_text

    check_outputs((file, ".toml"))
    spare(file, force)
    with written([(file, example_text())]):
        typer.echo(f"An example was written to {file}. Change it; headland farm check {file} says what is understood.")


@farm.command()
def example() -> None:
    """Print the example of a farm file.

    Example: headland farm example > farm.toml
    """
    from planner.farm import example_text

    typer.echo(example_text(), nl=False)


@farm.command()
def check(
    file: Annotated[str, typer.Argument(help="A farm file.")],
    json: AsJson = False,
) -> None:
    """Show what is understood of a farm file: every value in use, given or the default with its source.

    Example: headland farm check farm.toml
    """
    from planner.farm import load_farm
    from planner.farm.sources import farm_json, farm_sheet

    read = load_farm(file)
    if json:
        typer.echo(farm_json(read), nl=False)
        return
    from planner.commands.show import out
    from reports.trials import trials_table

    out(trials_table((farm_sheet(read, file),)))
