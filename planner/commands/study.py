"""`headland study`: the thesis's tables of fleet strategies beside our simulation."""

from __future__ import annotations

import typer

from planner.commands.options import AsJson


def study(json: AsJson = False) -> None:
    """Simulate Tables 6.1, 6.2 and 6.3 of the thesis, print them beside the printed times, and judge its claims.

    Example: headland study --json
    """
    from planner.commands.show import out, progress_bar, warm_up
    from planner.fleet_study import study as simulate

    warm_up()
    with progress_bar("Simulating the study") as progress:
        result = simulate(progress=progress)
    if json:
        from reports.export import study_json

        typer.echo(study_json(result), nl=False)
        return
    from reports.table import study_tables

    out(study_tables(result))
