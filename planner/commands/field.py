"""`headland field`: what a field is and what fits in it, before any plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from planner.commands.options import (
    Along,
    AsJson,
    Bearing,
    CellBearing,
    Corners,
    Crs,
    Entrance,
    FarmOption,
    FieldArgument,
    Headland,
    ImplementOption,
    Local,
    Margin,
    Swap,
    TracksOnly,
    TractorOption,
    Width,
    with_farm,
)

if TYPE_CHECKING:
    from planner.site import Site


def field(
    context: typer.Context,
    field: FieldArgument = "iwamizawa",
    width: Width = 3.0,
    headland: Headland = None,
    bearing: Bearing = None,
    cell_bearing: CellBearing = None,
    corners: Corners = "square",
    tracks_only: TracksOnly = False,
    margin: Margin = 0.3,
    entrance: Entrance = None,
    tractor: TractorOption = "eg105",
    farm: FarmOption = None,
    implement: ImplementOption = None,
    local: Local = False,
    crs: Crs = None,
    swap: Swap = False,
    along: Along = None,
    png: Annotated[Optional[Path], typer.Option(help="Write a map with tracks, rounds and cells.")] = None,  # noqa: UP045
    listed: Annotated[bool, typer.Option("--list", help="List every field of the file, and stop.")] = False,
    json: AsJson = False,
) -> None:
    """Show area, obstacles, cells, rounds and tracks of a field, what stays open and why, and which turns fit.

    In a GeoJSON file a feature with role "obstacle" is kept off, and a line along the boundary with edge "fence" (or
    edge "fence" on the boundary itself) is not crossed; "open" lines are openings, and a point with role "entrance" is
    the gate.

    Example: headland field denmark --width 6 --png denmark.png
    """
    from planner.commands.outputs import check_outputs, inputs, written
    from planner.commands.show import progress_bar, remark, warm_up
    from planner.describe import describe
    from planner.errors import ScenarioError
    from planner.scenario import Scenario, parse_cell_bearings, parse_place
    from planner.site import prepare

    check_outputs((png, ".png"), reads=inputs(field=field, tractor=tractor, farm=farm))
    if listed and png:
        raise ScenarioError("--png draws one field; leave it out with --list.")
    if listed:
        _list(field, local, crs, swap, json)
        return
    scenario = Scenario(
        field=field, local=local, width_m=width, headland_m=headland, bearing_deg=bearing, tractor=tractor,
        crs=crs, swap=swap, along=along, margin_m=margin, corners=corners, tracks_only=tracks_only,
        cell_bearings=parse_cell_bearings(cell_bearing or []),
        entrance=None if entrance is None else parse_place(entrance, "entrance"),
    )  # fmt: skip
    asked = with_farm(scenario, farm, implement, context)
    warm_up()
    with progress_bar("Laying out the field"):
        site = prepare(asked.scenario, tractor=asked.tractor, implement=asked.implement)
        facts = describe(site)
        results = [(png, _picture(site))] if png else []
    remark(site.layout.field.remarks)
    with written(results):
        _print(facts, json)


def _print(facts: dict[str, Any], json: bool) -> None:
    if json:
        from reports.export import facts_json

        typer.echo(facts_json(facts), nl=False)
        return
    from planner.commands.show import out
    from reports.field_report import field_report

    out(field_report(facts))


def _picture(site: Site) -> bytes:
    from planner.describe import outline_picture
    from reports.figures import map_figure, png_bytes

    return png_bytes(map_figure(outline_picture(site)))


def _list(field: str, local: bool, crs: str | None, swap: bool, json: bool) -> None:
    from fields.read import survey
    from planner.commands.show import remark
    from reports.parcels import parcels_json, parcels_table

    parcels, notes = survey(field, local=local, crs=crs, swap=swap)
    remark(notes)
    if json:
        typer.echo(parcels_json(parcels), nl=False)
        return
    from planner.commands.show import out

    out(parcels_table(parcels))
