"""`headland design`: choose tyres and the place of the centre of mass."""

from __future__ import annotations

from typing import Annotated

import typer

from planner.commands.options import AsJson, Html, Png, TractorOption


def design(
    study: Annotated[str, typer.Argument(help="tyres (Fig. 6.2) or mass (Fig. 6.3).")],
    tractor: TractorOption = "eg105",
    html: Html = None,
    png: Png = None,
    json: AsJson = False,
) -> None:
    """Sweep tyres or the centre of mass: where is the tractor stable at 35 degrees, and how tightly does it turn?

    Example: headland design tyres --html tyres.html
    """
    from planner.commands.outputs import check_outputs, inputs, written
    from planner.commands.show import out, warm_up
    from planner.commands.validate import pictures
    from vehicle.trials.sheets.catalogue import STUDIES, check_name
    from vehicle.trials.sheets.catalogue import design as run

    check_outputs((html, ".html"), (png, ".png"), reads=inputs(tractor=tractor))
    check_name(study, STUDIES, "study")
    warm_up()
    sheet = run(study, tractor)
    with written(pictures((sheet,), html, png)):
        if json:
            from reports.trials import sheet_json

            typer.echo(sheet_json(sheet), nl=False)
        else:
            from reports.trials import trials_table

            out(trials_table((sheet,)))
