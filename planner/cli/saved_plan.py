"""Saved plans on their way to terminals and back: `headland export` (guidance files), `show` (legs of each tractor),
`logs` (import logs of terminals), `compare` (a plan and its runs) and `learn` (values of the farm file)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.cli.common.options import AsJson, Html, PlanArgument, Png, RunsArgument, create_group
from planner.cli.common.outputs import (
    check_output_paths,
    make_folders,
    refuse_overwrite,
    render_requested,
    write_before_printing,
    write_into_folder,
)
from planner.cli.common.terminal import AnswerForm, create_progress_callback, print_remarks, print_renderable, warm_up
from planner.errors import RequestError
from planner.request.option_texts import format_clock

if TYPE_CHECKING:
    from planner.pipeline.outputs.saved_plans import SavedPlanRun
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
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
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
        check_output_paths(*((path, "") for path in paths), input_files={plan: "the plan"})
        with write_before_printing(results):
            names = [str(path) for path in paths]
            AnswerForm(json).print_answer(guidance, guidance_files, names, json=export_json, screen=build_export_table)


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
    facts = {
        "field": saved_run.request.field_name,
        "strategy": _get_strategy(saved_run),
        "start": start,
        "time_s": saved_run.run.duration_s,
        "stated": read_stated_figures(saved_run.saved),
    }
    AnswerForm(json).print_answer(
        saved_run,
        json=lambda run: format_leg_lists_json(run.steps, facts, tractor),
        screen=lambda run: build_leg_tables(_format_title(run), run.steps, start, tractor),
    )


def _format_title(saved_run: SavedPlanRun) -> str:
    """The plan in one line: when it is done and what it costs as its ranking stated it, else how long it takes."""
    from planner.pipeline.outputs.saved_plans import read_stated_figures
    from reports.common.wording import format_duration, format_price, format_tractor_count, round_up_to_minute

    request, duration = saved_run.request, format_duration(saved_run.run.duration_s)

    def format_end(seconds: float) -> str:
        if request.start_s is None:
            return f"in {format_duration(seconds)}"
        return f"by {request.format_clock_after(round_up_to_minute(seconds))}"

    plan = saved_run.saved.plan
    parts = [*filter(None, [_get_strategy(saved_run)]), format_tractor_count(plan.tractors - len(plan.resting))]
    stated = read_stated_figures(saved_run.saved)
    if stated is None:
        return f"{request.field_name}: {', '.join([*parts, f'done in {duration}'])}"
    late_s, cost = stated["late_end_s"], stated["cost"]
    late = "" if late_s is None else f" (95 % {format_end(late_s)})"
    parts.append(f"done {format_end(stated['end_s'])}{late}")
    if cost is not None:
        parts.append(f"{format_price(cost)} {stated['currency'] or ''}".rstrip())
    if late_s is not None:
        parts.append(f"without delays in {duration}")
    return f"{request.field_name}: {', '.join(parts)}"


def _get_strategy(saved_run: SavedPlanRun) -> str | None:
    """The strategy in the notes of the plan; None where they have none."""
    name = saved_run.saved.plan.notes.get("strategy")
    return name if isinstance(name, str) else None


def compare(plan: PlanArgument, runs: RunsArgument, html: Html = None, png: Png = None, json: AsJson = False) -> None:
    """Compare a plan with the logs of the work: time by activity, length, overlap, missed ground, largest differences.

    Runs in other fields are left out. The map shows planned and driven lines.

    Example: headland compare plan.json runs --html compare.html
    """
    from planner.pipeline.plan_comparison import compare_plan_with_runs
    from planner.task_logs.runs.run_files import list_run_files

    input_files: dict[str | Path, str] = {path: f"the log {path}" for path in list_run_files(runs)}
    check_output_paths((html, ".html"), (png, ".png"), input_files=input_files | {plan: "the plan"})
    warm_up()
    with create_progress_callback("Driving the plan again"):
        comparison = compare_plan_with_runs(plan, runs)
    from reports.plan.map_figure import render_png
    from reports.task_logs.report import (
        build_comparison_table,
        draw_comparison,
        format_comparison_json,
        render_comparison_page,
    )

    results = render_requested(
        (html, lambda: render_comparison_page(comparison)), (png, lambda: render_png(draw_comparison(comparison)))
    )
    with write_before_printing(results):
        AnswerForm(json).print_answer(comparison, json=format_comparison_json, screen=build_comparison_table)


def learn(
    runs: RunsArgument,
    farm: Annotated[Path, typer.Option(help="The farm file to update (headland farm new writes one).")],
    output: Annotated[
        Optional[Path], typer.Option("--out", "-o", help="Write to this file and leave the farm file unchanged.")
    ] = None,
    implement: Annotated[
        Optional[str], typer.Option(help="The implement of the logs; by default the one of their width.")
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Replace values that the file has already.")] = False,
    json: AsJson = False,
) -> None:
    """Learn speeds, turn times, stops and the order of the headland from imported runs for the farm file.

    Values in the file stay, unless they were learned before or --replace is given; all other bytes stay unchanged. Each
    value comes with its 95 % interval and its runs, and plans with --farm use and cite it.

    Example: headland learn runs --farm farm.toml
    """
    from planner.farm.inventory import parse_farm
    from planner.task_logs.farm_learning import learn_farm_values
    from planner.task_logs.runs.run_files import list_run_files
    from reports.common.text_tables import format_sentence
    from reports.task_logs.report import build_learned_table, format_learned_json

    input_files: dict[str | Path, str] = {path: f"the log {path}" for path in list_run_files(runs)}
    if output is not None:
        check_output_paths((output, ".toml"), input_files=input_files | {farm: "the farm file"}, force=False)
    warm_up()
    with create_progress_callback("Learning"):
        learned_farm = learn_farm_values(runs, farm, implement, replace)
    target = farm if output is None else output
    if output is not None:
        parse_farm(learned_farm.text, str(output), output.parent)  # paths of tractor files are relative to it
    check_output_paths((target, ".toml"), input_files=input_files)
    with write_before_printing([(target, learned_farm.text)]):
        AnswerForm(json).print_answer(
            learned_farm.values, learned_farm.notes, json=format_learned_json, screen=build_learned_table
        )
        if json:
            return
        unchanged_count = sum(one.done.startswith("kept") for one in learned_farm.values)
        unchanged_text = f"; {unchanged_count} unchanged (--replace takes the learned ones)" if unchanged_count else ""
        print_renderable(
            format_sentence(
                f"Written to {target}: {len(learned_farm.values) - unchanged_count} values{unchanged_text}."
            )
        )


logs = create_group(
    "Logs of work: import ISOXML time logs (TASKDATA), point Shapefiles, AgOpenGPS paths and CSV files.\n\n"
    "Example: headland logs import TASKDATA -o runs"
)


@logs.command("import")
def import_logs(
    files: Annotated[list[str], typer.Argument(help="Folders, zips or files with logs, as on the USB stick.")],
    output: Annotated[Path, typer.Option("--out", "-o", help="The folder for the runs; created if missing.")],
    mapping: Annotated[
        Optional[str],
        typer.Option(help="A TOML file that says which columns of a CSV file hold what ([columns] time = ...)."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite runs of the same name.")] = False,
    json: AsJson = False,
) -> None:
    """Turn logs of terminals into log files (CSV) with position, course, speed and work state, and a table of runs.

    The format is recognised: ISOXML time logs in a TASKDATA folder or zip, Shapefiles of points (John Deere export),
    AgOpenGPS folders with recorded paths, CSV files. A log that is cut off is read up to there. Every log gets a JSON
    file with its field, width, counters and figures. `headland compare` and `headland learn` take the folder.

    A mapping for CSV files is a TOML file: under [columns] time, longitude, latitude, and optionally speed_kmh or
    speed_mps and works, each with the name of a column in quotes; under [values] width_m and field.

    Example: headland logs import TASKDATA -o runs
    """
    from planner.task_logs.log_import import import_runs
    from reports.common.text_tables import format_sentence
    from reports.task_logs.report import build_runs_table, format_runs_json

    with create_progress_callback("Reading logs") as progress:
        imported_runs = import_runs(files, mapping, progress)
    print_remarks(imported_runs.notes)
    write_into_folder(output, imported_runs.files, force=force)
    AnswerForm(json).print_answer(
        imported_runs.runs, imported_runs.notes, json=format_runs_json, screen=lambda runs, _: build_runs_table(runs)
    )
    if not json:
        print_renderable(
            format_sentence(f"Written to {output}: {len(imported_runs.runs)} x log (CSV) and its data (JSON).")
        )


@logs.command()
def example(
    plan: PlanArgument,
    output: Annotated[Path, typer.Option("--out", "-o", help="The folder to make, such as TASKDATA.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the stops.")] = 1,
) -> None:
    """Write ISOXML time logs of a saved plan as a terminal would log them, to try imports without a machine.

    The tractors drive 10 % slower than planned and stop now and then; the stops are printed.

    Example: headland logs example plan.json -o TASKDATA
    """
    from planner.pipeline.example_logs import EXAMPLE_PACE, simulate_task_data
    from reports.common.text_tables import format_sentence

    for name in ("TASKDATA.XML", "TLG00001.xml", "TLG00001.bin"):
        refuse_overwrite(output / name, False)
    warm_up()
    with create_progress_callback("Driving the plan again"):
        task_data = simulate_task_data(plan, seed)
    write_into_folder(output, task_data.files, input_files={plan: "the plan"})
    pace_text = f"driven at {100 * EXAMPLE_PACE:.0f} % of the plan's speed"
    print_renderable(format_sentence(f"Written to {output}: {len(task_data.truths)} x time log, {pace_text}."))
    for number, truth in enumerate(task_data.truths, start=1):
        stops = ", ".join(f"{seconds:.0f} s" for seconds in truth.stops_s)
        print_renderable(
            format_sentence(f"Tractor {number}: {truth.time_s[-1] / 60.0:.1f} min; stops: {stops or 'none'}.")
        )
