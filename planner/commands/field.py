"""`headland field`: what a field is and what fits in it, before any plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from planner.commands.options import (
    AsJson,
    Bearing,
    FieldArgument,
    Headland,
    Local,
    TractorOption,
    Width,
    check_output,
)


def field(
    field: FieldArgument = "iwamizawa",
    width: Width = 3.0,
    headland: Headland = None,
    bearing: Bearing = None,
    tractor: TractorOption = "eg105",
    local: Local = False,
    png: Annotated[Optional[Path], typer.Option(help="Write a map with the tracks.")] = None,  # noqa: UP045
    json: AsJson = False,
) -> None:
    """Show area, headland and tracks of a field, and which turns fit.

    Example: headland field denmark --width 6 --png denmark.png
    """
    from planner.commands.show import out, warm_up
    from planner.describe import describe, outline_picture
    from planner.scenario import Scenario
    from planner.site import prepare

    check_output(png, ".png")
    scenario = Scenario(
        field=field, local=local, width_m=width, headland_m=headland, bearing_deg=bearing, tractor=tractor
    )
    warm_up()
    site = prepare(scenario)
    facts = describe(site)
    if json:
        from reports.export import facts_json

        typer.echo(facts_json(facts), nl=False)
    else:
        from reports.table import field_table

        out(field_table(facts))
    if png:
        from reports.figures import map_figure, save_png

        save_png(map_figure(outline_picture(site)), png)
