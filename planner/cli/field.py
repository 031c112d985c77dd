"""`headland field`: the facts of a field and what fits in it, before any plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Optional

import typer
from typer.core import TyperCommand

from planner.cli.common.language_options import translate_help
from planner.cli.common.options import (
    DEFAULT_FIELD,
    AsJson,
    FieldArgument,
    ForceOption,
    RunsArgument,
    inject_request_options,
    read_given_options,
)
from planner.cli.common.outputs import check_output_paths, list_input_files, write_before_printing
from planner.cli.common.terminal import AnswerForm, create_progress_callback, print_remarks, print_renderable, warm_up
from planner.errors import RequestError

FIELD_OPTIONS = (
    "width", "headland", "headland_passes", "bearing", "cell_bearing", "corners", "overhang", "open_edges",
    "no_headland", "margin", "entrance", "obstacle", "ignore", "tractor", "farm", "implement", "local", "crs",
    "swap_axes", "guidance_line", "elevation", "elevation_crs", "swaths",
)  # fmt: skip
"""Options of a plan that say how a field is laid out."""
HEIGHTS = "heights"


@inject_request_options(only=FIELD_OPTIONS, panels=False)
def field(
    context: typer.Context,
    field: FieldArgument = DEFAULT_FIELD,
    png: Annotated[Optional[Path], typer.Option(help="Write a map with tracks, headland passes and cells.")] = None,
    force: ForceOption = False,
    list_only: Annotated[bool, typer.Option("--list", help="Only list the fields of the file.")] = False,
    json: AsJson = False,
    **options: Any,
) -> None:
    """Show area, obstacles, cells, headland passes and tracks of a field, unworked ground and why, and which turns fit.

    With --elevation, or heights that the field file names, also slopes and the direction in which the field falls.
    `headland field heights` writes such a file from logs.

    In a GeoJSON file, tractors avoid a feature with role "obstacle" or without a role (--ignore leaves one out) and do
    not cross a boundary, or a line along it, with edge "fence"; "open" lines are openings, and a point with role
    "entrance" is the gate.

    Example: headland field denmark --width 6 --png denmark.png
    """
    from fields.documents.reader import list_fields_with_notes
    from planner.evaluation.preparation import prepare_context
    from planner.evaluation.work_order import WorkOrder
    from planner.pipeline.outputs.pictures import build_outline_picture, describe_field
    from reports.common.rendering import EXPORT_DECIMALS, format_json
    from reports.plan.field_report import build_field_report, build_parcels_table, format_parcels_json
    from reports.plan.map_figure import draw_plan_map, render_png

    given = read_given_options(context, options)
    check_output_paths((png, ".png"), input_files=list_input_files({**options, "field": field}), force=force)
    if list_only and png:
        raise RequestError("--png draws one field; leave it out with --list.")
    if list_only:
        reading = {name: options[name] for name in ("local", "crs", "swap_axes")}
        parcels, notes = list_fields_with_notes(field, **reading)
        print_remarks(notes)
        AnswerForm(json).print_answer(parcels, json=format_parcels_json, screen=build_parcels_table)
        return
    order = given.build_order(given.build_request(field=field))
    warm_up()
    with create_progress_callback("Laying out the field"):
        order = WorkOrder(order.request, tractor=order.tractor, implement=order.implement)
        planning_context = prepare_context(order)
        facts = describe_field(planning_context)
        picture = render_png(draw_plan_map(build_outline_picture(planning_context))) if png else b""
    elevation = planning_context.physics.elevation
    print_remarks((*planning_context.layout.field.remarks, *(() if elevation is None else elevation.remarks)))
    with write_before_printing((png, picture)):
        AnswerForm(json).print_answer(
            facts, json=lambda one: format_json(one, EXPORT_DECIMALS, is_ascii=False), screen=build_field_report
        )


def write_heights(
    runs: RunsArgument,
    output: Annotated[
        Path, typer.Option("--out", "-o", help="The raster to write: .tif (GeoTIFF) or .asc (ASCII grid).")
    ],
    force: ForceOption = False,
) -> None:
    """Write the heights in imported logs as a raster, for --elevation of plans.

    Runs are levelled to each other where they cross, and smoothed over a length that is printed; cells without points
    near have no data.

    Example: headland field heights runs -o heights.tif
    """
    from fields.terrain.rasters import list_raster_files, render_raster
    from planner.task_logs.runs.run_files import load_imported_runs
    from planner.task_logs.runs.worked_ground import build_run_heights
    from reports.common.text_tables import format_sentence

    input_files, files = list_input_files({}, runs=runs), list_raster_files(output)
    check_output_paths(*((file, "") for file in files), input_files=input_files, force=force)
    with create_progress_callback("Smoothing heights"):
        grid, crs = build_run_heights(load_imported_runs(runs))
        contents = render_raster(grid, crs, output)
    print_remarks(grid.remarks)
    with write_before_printing(*zip(files, contents, strict=True)):
        print_renderable(format_sentence(f"The heights are {grid.source}."))


heights_command = typer.Typer(add_completion=False, rich_markup_mode="markdown")
heights_command.command(HEIGHTS)(write_heights)


class FieldCommand(TyperCommand):
    """`headland field FIELD`, whose first word may be `heights` instead of a field."""

    def make_context(self, info_name: str | None, args: list[str], *others: Any, **options: Any) -> Any:
        """As typer does, for the command of heights if its word comes first."""
        if args[:1] != [HEIGHTS]:
            return super().make_context(info_name, args, *others, **options)
        command = typer.main.get_command(heights_command)
        translate_help(command)
        return command.make_context(f"{info_name} {HEIGHTS}", args[1:], *others, **options)
