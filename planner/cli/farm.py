"""`headland farm`: make and check a farm file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner.cli.common.options import AsJson, create_group
from planner.cli.common.outputs import check_output_paths, write_before_printing
from planner.cli.common.terminal import AnswerForm, print_sentence

farm = create_group("The farm file: tractors, implements, prices, times.\n\nExample: headland farm check farm.toml")


@farm.command()
def new(
    file: Annotated[Path, typer.Argument(help="The file to write, such as farm.toml.")],
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
) -> None:
    """Write an example of a farm file, to be adapted.

    Example: headland farm new farm.toml
    """
    from planner.farm.inventory import read_example_farm_text

    check_output_paths((file, ".toml"), force=force)
    with write_before_printing([(file, read_example_farm_text())]):
        print_sentence(f"An example was written to {file}. Adapt it, then check it with headland farm check {file}.")


@farm.command()
def example() -> None:
    """Print the example of a farm file.

    Example: headland farm example > farm.toml
    """
    from planner.farm.inventory import read_example_farm_text

    typer.echo(read_example_farm_text(), nl=False)


@farm.command()
def check(
    file: Annotated[str, typer.Argument(help="A farm file.")],
    json: AsJson = False,
) -> None:
    """Show every value in use of a farm file: given, or the default with its source.

    Example: headland farm check farm.toml
    """
    from planner.farm.inventory import load_farm
    from planner.farm.value_sources import build_farm_sheet, format_farm_json
    from reports.trials.report import build_trials_table

    AnswerForm(json).print_answer(
        load_farm(file),
        json=format_farm_json,
        screen=lambda shown: build_trials_table((build_farm_sheet(shown, file),)),
    )
