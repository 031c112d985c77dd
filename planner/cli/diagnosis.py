"""`headland diagnose` (what the simulation gets wrong in measured logs, and why) and `headland replay` (one run)."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.cli.common.options import NO_RESULT_STATUS, AsJson, ForceOption, TractorOption
from planner.cli.common.outputs import (
    Result,
    check_output_paths,
    list_input_files,
    write_before_printing,
)
from planner.cli.common.terminal import (
    AnswerForm,
    create_progress_callback,
    limit_linear_algebra_threads,
    print_renderable,
    print_sentence,
)
from planner.errors import RequestError
from planner.request.job_options import DIAGNOSIS_HELP
from planner.request.option_checks import check_demo_options

if TYPE_CHECKING:
    from planner.pipeline.log_ground import HeightFile
    from planner.pipeline.soil_rows import SoilLine
    from vehicle.identification.diagnosis.demo_logs import HiddenEffect
    from vehicle.identification.diagnosis.results import Diagnosis


FixOption = Annotated[
    Optional[list[str]],
    typer.Option("--fix", help=DIAGNOSIS_HELP["fix"]),
]
MappingOption = Annotated[
    Optional[str], typer.Option(help='A file (TOML) of the columns of the logs, such as speed_kmh = "v".')
]
ColumnOption = Annotated[
    Optional[list[str]],
    typer.Option("--column", help=DIAGNOSIS_HELP["column"]),
]
ElevationOption = Annotated[
    Optional[str], typer.Option(help="Heights of the ground, a raster or points, in place of roll and pitch.")
]
ElevationCrsOption = Annotated[
    Optional[str], typer.Option(help="Coordinate system of the heights, such as EPSG:25832, if the file lacks it.")
]
LogCrsOption = Annotated[
    Optional[str],
    typer.Option("--crs", help="Coordinate system of easting_m and northing_m; that of the heights by default."),
]
SaveSoilOption = Annotated[
    Optional[str],
    typer.Option(help="Add what was found of the soil to a table for plan --soil: NAME (in soils.csv), FILE#NAME."),
]
MoistureOption = Annotated[Optional[float], typer.Option(help="Moisture of that soil in the logs, % of dry weight.")]
GroundOption = Annotated[str, typer.Option(help=DIAGNOSIS_HELP["ground"])]


def diagnose(
    logs: Annotated[
        Optional[list[str]], typer.Argument(help="CSV or Parquet files, one run each; sample is a log to try.")
    ] = None,
    tractor: TractorOption = "eg105",
    ground: GroundOption = "soil",
    fix: FixOption = None,
    mapping: MappingOption = None,
    column: ColumnOption = None,
    as_driven: Annotated[bool, typer.Option("--as-driven", help=DIAGNOSIS_HELP["as_driven"])] = False,
    demo: Annotated[bool, typer.Option("--demo", help=DIAGNOSIS_HELP["demo"])] = False,
    seed: Annotated[Optional[int], typer.Option(help=DIAGNOSIS_HELP["seed"])] = None,
    hide: Annotated[Optional[str], typer.Option(help=DIAGNOSIS_HELP["hide"])] = None,
    html: Annotated[Optional[Path], typer.Option(help="Write the report as one page.")] = None,
    save: Annotated[
        Optional[Path], typer.Option(help="Write the tractor file with what was found, unless that harms unseen runs.")
    ] = None,
    holdout: Annotated[Optional[list[str]], typer.Option("--holdout", help=DIAGNOSIS_HELP["holdout"])] = None,
    elevation: ElevationOption = None,
    elevation_crs: ElevationCrsOption = None,
    crs: LogCrsOption = None,
    save_soil: SaveSoilOption = None,
    moisture: MoistureOption = None,
    next_drive: Annotated[
        Optional[Path], typer.Option(help="Write the plan of the drive to do next, if the logs leave a doubt.")
    ] = None,
    force: ForceOption = False,
    explain: Annotated[
        bool, typer.Option("--explain", help="Print every effect, every run and how to read them as well.")
    ] = False,
    json: AsJson = False,
) -> None:
    """Compare the simulation with measured logs, name the causes of its errors, and extend the tractor file.

    With --holdout, the tractor file of --save is only written if it lowers the error on runs that had no part in it.

    Example: headland diagnose runs/*.csv --tractor eg105 --holdout auto --html report.html --save my-eg105.toml
    """

    limit_linear_algebra_threads()

    conversions = {"--fix": fix, "--mapping": mapping, "--column": column}
    check_demo_options(demo, logs, conversions, {"seed": seed, "hide": hide}, as_driven)
    columns = _choose_mapping(mapping, column)
    heights = _choose_heights(elevation, elevation_crs, crs, demo)
    soil_line = _choose_soil_line(save_soil, moisture, ground, demo)
    soil_table = None if soil_line is None else soil_line.path
    outputs = (html, ".html"), (save, ".toml"), (next_drive, ".json"), (soil_table, ".csv")
    input_files = list_input_files({"tractor": tractor, "elevation": elevation, "mapping": mapping}, logs=logs or ())
    check_output_paths(*outputs, input_files=input_files, force=force, updated=(soil_table,))
    diagnosis, hidden = _run_diagnosis(
        logs, tractor, ground, fix, as_driven, 1 if seed is None else seed, hide, holdout or None, heights, columns
    )
    soil_results, unsaved_soil = _render_soil(diagnosis, soil_line)
    with write_before_printing(*_list_results(diagnosis, hidden, html, save, next_drive), *soil_results):
        _print_diagnosis(diagnosis, hidden, json, explain)
    _explain_unwritten_files(diagnosis, save, next_drive, unsaved_soil)


def _list_results(
    diagnosis: Diagnosis, hidden: HiddenEffect | None, html: Path | None, save: Path | None, next_drive: Path | None
) -> tuple[Result, ...]:
    from reports.diagnosis.page import render_diagnosis_page
    from vehicle.model.tractor_writer import format_tractor_toml

    next_plan = diagnosis.next_drive_plan
    return (
        (html, lambda: render_diagnosis_page(diagnosis, None if hidden is None else hidden.description)),
        (save if diagnosis.is_savable else None, lambda: format_tractor_toml(diagnosis.tractor)),
        (None if next_plan is None else next_drive, lambda: next_plan or ""),
    )


def _explain_unwritten_files(
    diagnosis: Diagnosis, save: Path | None, next_drive: Path | None, unsaved_soil: RequestError | None
) -> None:
    """Say why files are not written, and end the command without a result if the tractor or the soil is among them."""
    from reports.diagnosis.sentences import describe_unsaved

    if next_drive and diagnosis.next_drive_plan is None:
        typer.echo(f"{next_drive} is not written: these logs leave no doubt that one drive would settle.", err=True)
    if save and not diagnosis.is_savable:
        print_sentence(f"{save} is not written: {describe_unsaved(diagnosis)}", err=True)
        raise typer.Exit(NO_RESULT_STATUS)
    if unsaved_soil is not None:
        print_sentence(str(unsaved_soil), err=True)
        raise typer.Exit(NO_RESULT_STATUS)


def _choose_heights(elevation: str | None, elevation_crs: str | None, crs: str | None, demo: bool) -> HeightFile | None:
    """Raises RequestError for heights with --demo, and for a coordinate system without heights."""
    from planner.pipeline.log_ground import HeightFile

    if elevation is not None and demo:
        raise RequestError("--elevation is the ground of log files; leave it out with --demo.")
    if elevation is not None:
        return HeightFile(elevation, elevation_crs, crs)
    for name, value in (("--elevation-crs", elevation_crs), ("--crs", crs)):
        if value is not None:
            raise RequestError(f"{name} {value} needs heights; add --elevation or leave out {name}.")
    return None


def _choose_mapping(mapping: str | None, column: list[str] | None) -> list[str]:
    """The columns of --mapping and --column together; raises LogError."""
    from vehicle.identification.logs.table import list_pairs

    return [*list_pairs(mapping), *list_pairs(column)]


def _choose_soil_line(save_soil: str | None, moisture: float | None, ground: str, demo: bool) -> SoilLine | None:
    """Raises RequestError for a line that cannot be added, and for an option that would be ignored."""
    from planner.pipeline.soil_rows import parse_soil_line

    if save_soil is None:
        if moisture is not None:
            raise RequestError(f"--moisture {moisture:g} is that of a soil; add --save-soil or leave out --moisture.")
        return None
    if demo:
        raise RequestError("--save-soil learns from log files; leave it out with --demo.")
    return parse_soil_line(save_soil, moisture, ground)


def _render_soil(diagnosis: Diagnosis, line: SoilLine | None) -> tuple[list[Result], RequestError | None]:
    """The table with the line, or why there is none."""
    from planner.pipeline.soil_rows import build_soil_row, format_soil_table

    if line is None:
        return [], None
    try:
        return [(line.path, format_soil_table(build_soil_row(diagnosis, line), line.path))], None
    except RequestError as error:
        return [], error


def _run_diagnosis(
    logs: list[str] | None, tractor: str, ground: str, fix: list[str] | None, as_driven: bool, seed: int,
    hide: str | None, holdout: list[str] | None, heights: HeightFile | None, mapping: list[str],
) -> tuple[Diagnosis, HiddenEffect | None]:  # fmt: skip
    """The diagnosis, and without logs what the demonstration had hidden."""
    from planner.pipeline.diagnosis import diagnose as explain
    from planner.pipeline.diagnosis import diagnose_demo

    with create_progress_callback("Diagnosing") as progress:
        if not logs:
            return diagnose_demo(
                tractor=tractor, ground=ground, seed=seed, hidden_effect=hide, holdout=holdout, progress=progress
            )
        diagnosis = explain(
            logs, tractor=tractor, ground=ground, fixes=fix or (), mapping=mapping, use_driven_size=as_driven,
            holdout=holdout, heights=heights, progress=progress,
        )  # fmt: skip
        return diagnosis, None


def _print_diagnosis(diagnosis: Diagnosis, hidden: HiddenEffect | None, json: bool, explain: bool) -> None:
    from reports.common.text_tables import format_sentence
    from reports.common.wording import format_effect_with_id
    from reports.diagnosis.tables import build_diagnosis_screen, build_diagnosis_table, format_diagnosis_json

    screen = build_diagnosis_table if explain else build_diagnosis_screen
    AnswerForm(json).print_answer(diagnosis, json=partial(format_diagnosis_json, hidden=hidden), screen=screen)
    if hidden is not None and not json:
        print_renderable(
            format_sentence(f"Hidden in these simulated logs: {format_effect_with_id(hidden.id)}. {hidden.description}")
        )


def replay(
    log: Annotated[str, typer.Argument(help="A CSV or Parquet file with one run; sample is a log to try.")],
    tractor: TractorOption = "eg105",
    ground: GroundOption = "soil",
    fix: FixOption = None,
    mapping: MappingOption = None,
    column: ColumnOption = None,
    elevation: ElevationOption = None,
    elevation_crs: ElevationCrsOption = None,
    crs: LogCrsOption = None,
    png: Annotated[Optional[Path], typer.Option(help="Write the picture.")] = None,
    html: Annotated[Optional[Path], typer.Option(help="Write the picture and the errors as one page.")] = None,
    force: ForceOption = False,
    json: AsJson = False,
) -> None:
    """Simulate the commands of a measured run with the effects of the tractor file, and compare both.

    Example: headland replay run.csv --tractor my-eg105.toml --png run.png
    """

    limit_linear_algebra_threads()
    from planner.pipeline.replays import replay as simulate
    from reports.diagnosis.replay import build_replay_table, draw_replay, format_replay_json, render_replay_page
    from reports.plan.map_figure import render_png

    heights, columns = _choose_heights(elevation, elevation_crs, crs, demo=False), _choose_mapping(mapping, column)
    input_files = list_input_files({"tractor": tractor, "elevation": elevation, "mapping": mapping}, logs=[log])
    check_output_paths((png, ".png"), (html, ".html"), input_files=input_files, force=force)
    result = simulate(log, tractor=tractor, ground=ground, fixes=fix or (), mapping=columns, heights=heights)
    with write_before_printing(
        (png, lambda: render_png(draw_replay(result.replayed))),
        (html, lambda: render_replay_page(result.replayed, result.remarks)),
    ):
        AnswerForm(json).print_answer(
            result.replayed, result.remarks, json=format_replay_json, screen=build_replay_table
        )
