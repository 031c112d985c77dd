"""`headland compare`: a saved plan against the runs that were driven of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from planner.commands.options import AsJson, Html, Png

if TYPE_CHECKING:
    from planner.commands.outputs import Content


def compare(
    plan: Annotated[Path, typer.Argument(help="A plan written by headland plan --save.")],
    runs: Annotated[list[Path], typer.Argument(help="The folder of headland logs import, or log files in it.")],
    html: Html = None,
    png: Png = None,
    json: AsJson = False,
) -> None:
    """Compare a plan with what was driven: time by kind, length, overlap and missed ground, and what differs most.

    Runs in other fields are left out. The map has planned and driven lines together.

    Example: headland compare plan.json runs --html compare.html
    """
    from planner.commands.outputs import check_outputs, written
    from planner.commands.show import progress_bar, warm_up
    from planner.works.comparing import compare as compared
    from planner.works.files import run_files

    reads: dict[str | Path, str] = {path: f"the log {path}" for path in run_files(runs)}
    check_outputs((html, ".html"), (png, ".png"), reads=reads | {plan: "the plan"})
    warm_up()
    with progress_bar("Driving the plan again"):
        found = compared(plan, runs)
    from reports.work_compare import comparison_figure, comparison_json, comparison_page, comparison_table

    results: list[tuple[Path, Content]] = []
    if html:
        results.append((html, comparison_page(found)))
    if png:
        from reports.figures import png_bytes

        results.append((png, png_bytes(comparison_figure(found))))
    with written(results):
        if json:
            typer.echo(comparison_json(found), nl=False)
            return
        from planner.commands.show import out

        out(comparison_table(found))
