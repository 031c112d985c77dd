"""`headland field`: the facts of a field and what fits in it, before any plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from planner.cli.common.options import AsJson, FieldArgument, build_plan_inputs, inject_request_options
from planner.request.options import convert_options_to_parameters
from planner.request.plan_request import FarmChoice, PlanRequest

if TYPE_CHECKING:
    from planner.evaluation.context import PlanningContext


FIELD_OPTIONS = (
    "width", "headland", "headland_passes", "bearing", "cell_bearing", "corners", "overhang", "no_headland", "margin",
    "entrance", "obstacle", "ignore", "tractor", "farm", "implement", "local", "crs", "swap_axes", "guidance_line",
)  # fmt: skip
"""Options of a plan that say how a field is laid out."""


@inject_request_options(only=FIELD_OPTIONS, panels=False)
def field(
    context: typer.Context,
    field: FieldArgument = "iwamizawa",
    png: Annotated[Optional[Path], typer.Option(help="Write a map with tracks, headland passes and cells.")] = None,
    list_only: Annotated[bool, typer.Option("--list", help="Only list the fields of the file.")] = False,
    json: AsJson = False,
    **options: Any,
) -> None:
    """Show area, obstacles, cells, headland passes and tracks of a field, unworked ground and why, and which turns fit.

    In a GeoJSON file, tractors avoid a feature with role "obstacle" or without a role (--ignore leaves one out) and do
    not cross a boundary, or a line along it, with edge "fence"; "open" lines are openings, and a point with role
    "entrance" is the gate.

    Example: headland field denmark --width 6 --png denmark.png
    """
    from planner.cli.common.outputs import check_output_paths, list_input_files, write_before_printing
    from planner.cli.common.terminal import create_progress_callback, print_remarks, warm_up
    from planner.errors import RequestError
    from planner.evaluation.context import prepare_context
    from planner.pipeline.outputs.pictures import describe_field

    choice = FarmChoice(**convert_options_to_parameters(FarmChoice, options))
    check_output_paths(
        (png, ".png"), input_files=list_input_files(field=field, tractor=options["tractor"], farm=choice.farm)
    )
    if list_only and png:
        raise RequestError("--png draws one field; leave it out with --list.")
    if list_only:
        _list_parcels(field, options["local"], options["crs"], options["swap_axes"], json)
        return
    request = PlanRequest.from_options(options | {"field": field})
    plan_inputs = build_plan_inputs(request, choice.farm, choice.implement, context)
    warm_up()
    with create_progress_callback("Laying out the field"):
        planning_context = prepare_context(
            plan_inputs.request, tractor=plan_inputs.tractor, implement=plan_inputs.implement
        )
        facts = describe_field(planning_context)
        results = [(png, _draw_map(planning_context))] if png else []
    print_remarks(planning_context.layout.field.remarks)
    with write_before_printing(results):
        _print_facts(facts, json)


def _print_facts(facts: dict[str, Any], json: bool) -> None:
    if json:
        from reports.plan.ranking_export import format_facts_json

        typer.echo(format_facts_json(facts), nl=False)
        return
    from planner.cli.common.terminal import print_renderable
    from reports.plan.field_report import build_field_report

    print_renderable(build_field_report, facts)


def _draw_map(planning_context: PlanningContext) -> bytes:
    from planner.pipeline.outputs.pictures import build_outline_picture
    from reports.plan.map_figure import draw_plan_map, render_png

    return render_png(draw_plan_map(build_outline_picture(planning_context)))


def _list_parcels(field: str, local: bool, crs: str | None, swap_axes: bool, json: bool) -> None:
    from fields.documents.reader import list_fields_with_notes
    from planner.cli.common.terminal import print_remarks
    from reports.plan.field_report import build_parcels_table, format_parcels_json

    parcels, notes = list_fields_with_notes(field, local=local, crs=crs, swap_axes=swap_axes)
    print_remarks(notes)
    if json:
        typer.echo(format_parcels_json(parcels), nl=False)
        return
    from planner.cli.common.terminal import print_renderable

    print_renderable(build_parcels_table, parcels)
