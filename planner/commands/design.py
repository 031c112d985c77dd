"""`headland design`: choose tyres and the place of the centre of mass."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from planner.commands.options import AsJson, TractorOption, check_output


def design(
    study: Annotated[str, typer.Argument(help="tyres (Fig. 6.2) or mass (Fig. 6.3).")],
    tractor: TractorOption = "eg105",
    html: Annotated[Optional[Path], typer.Option(help="Write a page with pictures.")] = None,  # noqa: UP045
    png: Annotated[Optional[Path], typer.Option(help="Write the pictures.")] = None,  # noqa: UP045
    json: AsJson = False,
) -> None:
    """Sweep tyres or the centre of mass: where is the tractor stable at 35 degrees, and how tightly does it turn?

    Example: headland design tyres --html tyres.html
    """
    from planner.commands.show import out, warm_up
    from planner.commands.validate import write_pictures
    from vehicle.trials.sheets.catalogue import STUDIES, check_name
    from vehicle.trials.sheets.catalogue import design as run

    check_output(html, ".html")
    check_output(png, ".png")
    check_name(study, STUDIES, "study")
    warm_up()
    sheet = run(study, tractor)
    if json:
        from reports.trials import sheet_json

        typer.echo(sheet_json(sheet), nl=False)
    else:
        from reports.trials import trials_table

        out(trials_table((sheet,)))
    write_pictures((sheet,), html, png)
