"""`headland export` (guidance files of a saved plan) and `headland show` (the legs of each tractor)."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.cli.common.options import AsJson, ForceOption, PlanArgument
from planner.cli.common.outputs import check_output_paths, make_folders, refuse_overwrite, write_before_printing
from planner.cli.common.terminal import AnswerForm, create_progress_callback, print_remarks, warm_up
from planner.errors import RequestError
from planner.request.option_texts import format_clock

if TYPE_CHECKING:
    from planner.pipeline.outputs.saved_plans import SavedPlanRun, StatedFigures
    from reports.plan.guidance_export import GuidanceFiles


ZIP_SUFFIX, TASKDATA_FOLDER = ".zip", "TASKDATA"
FORMAT_HELP = "isoxml4, isoxml3, agopengps, kml, shapefile, geojson or gpx."
OUTPUT_HELP = "File, folder (such as a USB stick) or .zip to write; by default named after the plan."
CURVES_HELP = (
    "Write curves, or only straight lines, as some terminals refuse curves: a curve of few straight segments is cut "
    "into them, others are left out. Default: only straight lines in ISOXML version 3, curves in other formats."
)


def export(
    plan: PlanArgument,
    to: Annotated[str, typer.Option("--to", help=FORMAT_HELP)],
    output: Annotated[Optional[Path], typer.Option("--out", "-o", help=OUTPUT_HELP)] = None,
    tractor: Annotated[Optional[int], typer.Option(help="Write only this tractor, counted from 1.")] = None,
    curves: Annotated[Optional[bool], typer.Option("--curves/--straight", help=CURVES_HELP)] = None,
    force: ForceOption = False,
    json: AsJson = False,
) -> None:
    """Write boundary, headland and guidance lines of a saved plan for terminals and maps, by tractor in driving order.

    Example: headland export plan.json --to isoxml4 --out TASKDATA.zip

    For a USB stick: headland export plan.json --to isoxml4 --out /media/stick (makes TASKDATA/TASKDATA.XML).
    """
    from planner.pipeline.outputs.guidance_lines import build_guidance, find_format
    from planner.pipeline.outputs.saved_plans import load_saved_plan
    from reports.plan.guidance_export import build_export_table, collect_remarks, export_json, write_guidance

    form = find_format(to)
    guidance = build_guidance(load_saved_plan(plan), tractor)
    guidance_files = write_guidance(guidance, form, curves)
    target, results = _place_files(guidance_files, output, plan)
    paths = [path for path, _ in results]
    for path in paths:
        refuse_overwrite(path, force)
    print_remarks(collect_remarks(guidance, guidance_files))
    if not target.parent.is_dir():
        raise RequestError(f"{target} cannot be written: the folder {target.parent} does not exist; make it first.")
    folders = {parent for path in paths for parent in path.parents if parent == target or target in parent.parents}
    with make_folders(*sorted(folders, key=lambda folder: len(folder.parts))):
        check_output_paths(*((path, "") for path in paths), input_files={plan: "the plan"}, force=force)
        with write_before_printing(*results):
            names = [str(path) for path in paths]
            AnswerForm(json).print_answer(
                guidance, guidance_files, names, json=export_json, screen=lambda *shown: build_export_table(*shown[:2])
            )


def _place_files(
    guidance_files: GuidanceFiles, output: Path | None, plan: Path
) -> tuple[Path, list[tuple[Path, bytes]]]:
    """The file or folder to write, and the files with their paths."""
    from fields.formats.guidance import zip_files

    suffix = guidance_files.format.extension
    if output is not None and output.suffix.lower() == ZIP_SUFFIX and not output.is_dir():
        return output, [(output, zip_files(guidance_files.files))]
    target = output or Path(
        f"{plan.stem}{suffix}" if guidance_files.is_single_file else f"{plan.stem}-{guidance_files.format.name}"
    )
    if guidance_files.is_single_file:
        file_path = target / f"{plan.stem}{suffix}" if target.is_dir() else target
        if file_path.suffix.lower() != suffix:
            raise RequestError(f"{file_path} does not end in {suffix}; name the file {file_path.with_suffix(suffix)}.")
        return file_path, [(file_path, content) for content in guidance_files.files.values()]
    if target.exists() and not target.is_dir():
        raise RequestError(f"{target} is a file, and {guidance_files.format.title} needs a folder; name a folder.")
    if suffix and target.suffix.lower() == suffix:
        raise RequestError(
            f"{target} is one file, and {guidance_files.format.title} has one for each tractor; name a folder, or add "
            "--tractor N."
        )
    if target.name.upper() == TASKDATA_FOLDER and all(
        path.startswith(f"{TASKDATA_FOLDER}/") for path in guidance_files.files
    ):
        target = target.parent  # the named folder is the one that is made
    return target, [(target.joinpath(*path.split("/")), content) for path, content in guidance_files.files.items()]


def show(
    plan: PlanArgument,
    tractor: Annotated[Optional[int], typer.Option(help="Show only this tractor, counted from 1.")] = None,
    json: AsJson = False,
) -> None:
    """Show the legs of every tractor of a saved plan in order: what, start, length and duration.

    Example: headland show plan.json --tractor 2
    """
    from planner.pipeline.outputs.saved_plans import read_stated_figures, simulate_saved_plan
    from reports.plan.leg_list import build_leg_tables, format_leg_lists_json

    warm_up()
    with create_progress_callback("Driving the plan again"):
        saved_run = simulate_saved_plan(plan)
    print_remarks(  # of a plan that was changed after it was saved
        f"Tractors {first + 1} and {second + 1} collide after {time:.0f} s; plan the field again."
        for time, first, second in saved_run.run.contacts
    )
    count = len(saved_run.steps)
    if tractor is not None and not 1 <= tractor <= count:
        raise RequestError(f"--tractor is {tractor}; the plan has tractors 1 to {count}.", parameter="tractor")
    start = None if saved_run.request.start_s is None else format_clock(saved_run.request.start_s)
    stated = read_stated_figures(saved_run.saved)
    facts = {
        "field": saved_run.request.field_name,
        "strategy": saved_run.saved.plan.notes.strategy or None,
        "start": start,
        "time_s": saved_run.run.duration_s,
        "stated": stated and asdict(stated),
    }
    AnswerForm(json).print_answer(
        saved_run,
        json=lambda run: format_leg_lists_json(run.steps, facts, tractor),
        screen=lambda run: build_leg_tables(_format_title(run, stated), run.steps, start, tractor),
    )


def _format_title(saved_run: SavedPlanRun, stated: StatedFigures | None) -> str:
    """The plan in one line: when it is done and what it costs as its ranking stated it, else how long it takes."""
    from reports.common.wording import format_duration, format_price, format_tractor_count, round_up_to_minute

    request, duration = saved_run.request, format_duration(saved_run.run.duration_s)

    def format_end(seconds: float) -> str:
        if request.start_s is None:
            return f"in {format_duration(seconds)}"
        return f"by {request.format_clock_after(round_up_to_minute(seconds))}"

    plan = saved_run.saved.plan
    parts = [*filter(None, [plan.notes.strategy]), format_tractor_count(plan.tractors - len(plan.resting))]
    if stated is None:
        return f"{request.field_name}: {', '.join([*parts, f'done in {duration}'])}"
    late_s, cost = stated.late_end_s, stated.cost
    late = "" if late_s is None else f" (95 % {format_end(late_s)})"
    parts.append(f"done {format_end(stated.end_s)}{late}")
    if cost is not None:
        parts.append(f"{format_price(cost)} {stated.currency or ''}".rstrip())
    if late_s is not None:
        parts.append(f"without delays in {duration}")
    return f"{request.field_name}: {', '.join(parts)}"
