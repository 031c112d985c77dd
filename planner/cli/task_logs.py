"""`headland logs` (import logs of terminals), `compare` (a plan and its runs) and `learn` (values of the farm file)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from planner.cli.common.options import AsJson, ForceOption, Html, PlanArgument, Png, RunsArgument, create_group
from planner.cli.common.outputs import (
    check_output_paths,
    list_input_files,
    refuse_overwrite,
    write_before_printing,
    write_into_folder,
)
from planner.cli.common.terminal import AnswerForm, create_progress_callback, print_remarks, print_renderable, warm_up


def compare(
    plan: PlanArgument,
    runs: RunsArgument,
    html: Html = None,
    png: Png = None,
    force: ForceOption = False,
    json: AsJson = False,
) -> None:
    """Compare a plan with the logs of the work: time by activity, length, overlap, missed ground, largest differences.

    Runs in other fields are left out. The map shows planned and driven lines.

    Example: headland compare plan.json runs --html compare.html
    """
    from planner.pipeline.plan_comparison import compare_plan_with_runs

    input_files = list_input_files({}, runs=runs) | {plan: "the plan"}
    check_output_paths((html, ".html"), (png, ".png"), input_files=input_files, force=force)
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

    with write_before_printing(
        (html, lambda: render_comparison_page(comparison)), (png, lambda: render_png(draw_comparison(comparison)))
    ):
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
    force: ForceOption = False,
    json: AsJson = False,
) -> None:
    """Learn speeds, turn times, stops and the order of the headland from imported runs for the farm file.

    Values in the file stay, unless they were learned before or --replace is given; all other bytes stay unchanged. Each
    value comes with its 95 % interval and its runs, and plans with --farm use and cite it.

    Example: headland learn runs --farm farm.toml
    """
    from planner.farm.inventory import parse_farm
    from planner.task_logs.farm_learning import learn_farm_values
    from reports.common.text_tables import format_sentence
    from reports.task_logs.report import build_learned_table, format_learned_json

    input_files = list_input_files({}, runs=runs)
    if output is not None:
        check_output_paths((output, ".toml"), input_files=input_files | {farm: "the farm file"}, force=force)
    warm_up()
    with create_progress_callback("Learning"):
        learned_farm = learn_farm_values(runs, farm, implement, replace)
    target = farm if output is None else output
    if output is not None:
        parse_farm(learned_farm.text, str(output), output.parent)  # paths of tractor files are relative to it
    check_output_paths((target, ".toml"), input_files=input_files, force=force, updated=(farm,))
    with write_before_printing((target, learned_farm.text)):
        AnswerForm(json).print_answer(
            learned_farm.values, learned_farm.notes, json=format_learned_json, screen=build_learned_table
        )
        if json:
            return
        unchanged_count = sum(one.done.startswith("kept") for one in learned_farm.values)
        unchanged_text = f"; {unchanged_count} unchanged (--replace takes the learned ones)" if unchanged_count else ""
        print_renderable(
            format_sentence(f"Values that are learned: {len(learned_farm.values) - unchanged_count}{unchanged_text}.")
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
    force: ForceOption = False,
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
    from reports.task_logs.report import build_runs_table, format_runs_json

    with create_progress_callback("Reading logs") as progress:
        imported_runs = import_runs(files, mapping, progress)
    print_remarks(imported_runs.notes)
    write_into_folder(output, imported_runs.files, force=force)
    AnswerForm(json).print_answer(
        imported_runs.runs, imported_runs.notes, json=format_runs_json, screen=lambda runs, _: build_runs_table(runs)
    )


@logs.command()
def example(
    plan: PlanArgument,
    output: Annotated[Path, typer.Option("--out", "-o", help="The folder to make, such as TASKDATA.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the stops.")] = 1,
    force: ForceOption = False,
) -> None:
    """Write ISOXML time logs of a saved plan as a terminal would log them, to try imports without a machine.

    The tractors drive 10 % slower than planned and stop now and then; the stops are printed.

    Example: headland logs example plan.json -o TASKDATA
    """
    from planner.pipeline.example_logs import EXAMPLE_PACE, simulate_task_data
    from reports.common.text_tables import format_sentence

    for name in ("TASKDATA.XML", "TLG00001.xml", "TLG00001.bin"):
        refuse_overwrite(output / name, force)
    warm_up()
    with create_progress_callback("Driving the plan again"):
        task_data = simulate_task_data(plan, seed)
    write_into_folder(output, task_data.files, input_files={plan: "the plan"}, force=force)
    pace_text = f"driven at {100 * EXAMPLE_PACE:.0f} % of the plan's speed"
    print_renderable(format_sentence(f"Tractors with a time log: {len(task_data.truths)}, {pace_text}."))
    for number, truth in enumerate(task_data.truths, start=1):
        stops = ", ".join(f"{seconds:.0f} s" for seconds in truth.stops_s)
        print_renderable(
            format_sentence(f"Tractor {number}: {truth.time_s[-1] / 60.0:.1f} min; stops: {stops or 'none'}.")
        )
