"""`headland diagnose`: what the simulation gets wrong in measured logs, why, and what mending it gains."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.commands.options import AsJson, TractorOption, check_output, write_text

if TYPE_CHECKING:
    from planner.diagnosis import Order
    from vehicle.measured.demo import Hidden
    from vehicle.measured.verdict import Diagnosis

Fixes = Annotated[
    Optional[list[str]],  # noqa: UP045 - typer reads this at run time
    typer.Option("--fix", help="A convention to convert from, such as steering-left-positive; can be given again."),
]
Ground = Annotated[str, typer.Option(help="Ground the logs were made on: soil or asphalt.")]


def diagnose(
    logs: Annotated[Optional[list[str]], typer.Argument(help="CSV or Parquet files, one run each.")] = None,  # noqa: UP045
    tractor: TractorOption = "eg105",
    ground: Ground = "soil",
    fix: Fixes = None,
    demo: Annotated[bool, typer.Option("--demo", help="Hide an effect in made logs and find it.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of the demonstration.")] = 1,
    hide: Annotated[Optional[str], typer.Option(help="Effect to hide in the demonstration; by default drawn.")] = None,  # noqa: UP045
    html: Annotated[Optional[Path], typer.Option(help="Write the report as one page.")] = None,  # noqa: UP045
    save: Annotated[Optional[Path], typer.Option(help="Write the tractor file with what was found.")] = None,  # noqa: UP045
    json: AsJson = False,
) -> None:
    """Compare the simulation with measured logs, name what it gets wrong, and extend the tractor file.

    Example: headland diagnose runs/*.csv --tractor eg105 --ground soil --html report.html --save my-eg105.toml
    """
    from planner.commands.single import one_thread

    one_thread()
    from planner.diagnosis import Order

    check_output(html, ".html")
    check_output(save)
    order = Order(tuple(logs or ()), tractor, ground, tuple(fix or ()), demo, seed, hide)
    found, hidden = _found(order)
    _print(found, hidden, json)
    if html:
        from reports.diagnosis_page import diagnosis_page

        write_text(html, diagnosis_page(found, None if hidden is None else hidden.words))
    if save:
        from vehicle.measured.save import tractor_toml

        write_text(save, tractor_toml(found.tractor))


def _found(order: Order) -> tuple[Diagnosis, Hidden | None]:
    from planner.commands.show import progress_bar
    from planner.diagnosis import diagnosed

    with progress_bar("Diagnosing") as progress:
        return diagnosed(order, progress)


def _print(found: Diagnosis, hidden: Hidden | None, json: bool) -> None:
    if json:
        from reports.diagnosis_export import diagnosis_json

        typer.echo(diagnosis_json(found), nl=False)
        return
    from planner.commands.show import out
    from reports.diagnosis_table import diagnosis_table

    out(diagnosis_table(found))
    if hidden is not None:
        out(f"Hidden in these logs, which this simulator made itself: {hidden.id}. {hidden.words}")
