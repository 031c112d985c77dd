"""`headland diagnose` (what the simulation gets wrong in measured logs, and why) and `headland replay` (one run)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.cli.common.options import AsJson, TractorOption

if TYPE_CHECKING:
    from planner.cli.common.outputs import OutputContent
    from vehicle.identification.verdict.demo_logs import HiddenEffect
    from vehicle.identification.verdict.diagnosis_types import Diagnosis


FixOption = Annotated[
    Optional[list[str]],
    typer.Option("--fix", help="A convention to convert from, such as steering-left-positive; may be repeated."),
]
GroundOption = Annotated[str, typer.Option(help="Ground the logs were made on: soil or asphalt.")]


def diagnose(
    logs: Annotated[
        Optional[list[str]], typer.Argument(help="CSV or Parquet files, one run each; sample is a log to try.")
    ] = None,
    tractor: TractorOption = "eg105",
    ground: GroundOption = "soil",
    fix: FixOption = None,
    as_driven: Annotated[
        bool, typer.Option("--as-driven", help="Take the vehicle size from the logs where the tractor file differs.")
    ] = False,
    demo: Annotated[bool, typer.Option("--demo", help="Hide an effect in simulated logs and find it.")] = False,
    seed: Annotated[Optional[int], typer.Option(help="Seed of the demonstration, 1 by default.")] = None,
    hide: Annotated[Optional[str], typer.Option(help="Effect to hide in the demonstration; random by default.")] = None,
    html: Annotated[Optional[Path], typer.Option(help="Write the report as one page.")] = None,
    save: Annotated[Optional[Path], typer.Option(help="Write the tractor file with what was found.")] = None,
    next_drive: Annotated[
        Optional[Path], typer.Option(help="Write the plan of the drive to do next, if the logs leave a doubt.")
    ] = None,
    json: AsJson = False,
) -> None:
    """Compare the simulation with measured logs, name the causes of its errors, and extend the tractor file.

    Example: headland diagnose runs/*.csv --tractor eg105 --ground soil --html report.html --save my-eg105.toml
    """
    from planner.cli.common.terminal import limit_linear_algebra_threads

    limit_linear_algebra_threads()
    from planner.cli.common.outputs import check_output_paths, list_input_files, write_before_printing

    _check_demo_options(demo, logs, seed, hide, fix, as_driven)
    outputs = (html, ".html"), (save, ".toml"), (next_drive, ".json")
    check_output_paths(*outputs, input_files=list_input_files(logs=logs or (), tractor=tractor))
    diagnosis, hidden = _run_diagnosis(logs, tractor, ground, fix, as_driven, 1 if seed is None else seed, hide)
    with write_before_printing(_render_report(diagnosis, hidden, html, save, next_drive)):
        _print_diagnosis(diagnosis, hidden, json)
    if next_drive and diagnosis.next_drive_plan is None:
        typer.echo(f"{next_drive} is not written: these logs leave no doubt that one drive would settle.", err=True)


def _render_report(
    diagnosis: Diagnosis, hidden: HiddenEffect | None, html: Path | None, save: Path | None, next_drive: Path | None
) -> list[tuple[Path, OutputContent]]:
    results: list[tuple[Path, OutputContent]] = []
    if html:
        from reports.diagnosis.page import render_diagnosis_page

        results.append((html, render_diagnosis_page(diagnosis, None if hidden is None else hidden.description)))
    if save:
        from vehicle.model.tractor_writer import format_tractor_toml

        results.append((save, format_tractor_toml(diagnosis.tractor)))
    if next_drive and diagnosis.next_drive_plan is not None:
        results.append((next_drive, diagnosis.next_drive_plan))
    return results


def _check_demo_options(
    demo: bool, logs: list[str] | None, seed: int | None, hide: str | None, fix: list[str] | None, as_driven: bool
) -> None:
    """Raise RequestError for both or neither of logs and --demo, and for an option that would be ignored."""
    from planner.errors import RequestError

    if demo == bool(logs):
        raise RequestError("Give either log files or --demo.")
    if demo and fix:
        raise RequestError("--fix converts log files; leave it out with --demo.")
    if demo and as_driven:
        raise RequestError("--as-driven takes the size from log files; leave it out with --demo.")
    for name, value in (("--seed", seed), ("--hide", hide)):
        if value is not None and not demo:
            raise RequestError(f"{name} {value} needs the demonstration; add --demo or leave out {name}.")


def _run_diagnosis(
    logs: list[str] | None, tractor: str, ground: str, fix: list[str] | None, as_driven: bool, seed: int,
    hide: str | None,
) -> tuple[Diagnosis, HiddenEffect | None]:  # fmt: skip
    """The diagnosis, and without logs what the demonstration had hidden."""
    from planner.cli.common.terminal import create_progress_callback
    from planner.pipeline.diagnosis import diagnose as explain
    from planner.pipeline.diagnosis import diagnose_demo

    with create_progress_callback("Diagnosing") as progress:
        if not logs:
            return diagnose_demo(tractor=tractor, ground=ground, seed=seed, hidden_effect=hide, progress=progress)
        diagnosis = explain(
            logs, tractor=tractor, ground=ground, fixes=fix or (), use_driven_size=as_driven, progress=progress
        )
        return diagnosis, None


def _print_diagnosis(diagnosis: Diagnosis, hidden: HiddenEffect | None, json: bool) -> None:
    if json:
        from reports.diagnosis.tables import format_diagnosis_json

        typer.echo(format_diagnosis_json(diagnosis, hidden), nl=False)
        return
    from planner.cli.common.terminal import print_renderable
    from reports.diagnosis.tables import build_diagnosis_table

    print_renderable(build_diagnosis_table, diagnosis)
    if hidden is not None:
        from reports.common.effect_names import format_effect_with_id
        from reports.common.text_tables import format_sentence

        print_renderable(
            format_sentence(f"Hidden in these simulated logs: {format_effect_with_id(hidden.id)}. {hidden.description}")
        )


def replay(
    log: Annotated[str, typer.Argument(help="A CSV or Parquet file with one run; sample is a log to try.")],
    tractor: TractorOption = "eg105",
    ground: GroundOption = "soil",
    fix: FixOption = None,
    png: Annotated[Optional[Path], typer.Option(help="Write the picture.")] = None,
    html: Annotated[Optional[Path], typer.Option(help="Write the picture and the errors as one page.")] = None,
    json: AsJson = False,
) -> None:
    """Simulate the commands of a measured run with the effects of the tractor file, and compare both.

    Example: headland replay run.csv --tractor my-eg105.toml --png run.png
    """
    from planner.cli.common.terminal import limit_linear_algebra_threads

    limit_linear_algebra_threads()
    from planner.cli.common.outputs import check_output_paths, list_input_files, write_before_printing
    from planner.pipeline.diagnosis import replay as simulate
    from reports.diagnosis.replay import build_replay_table, draw_replay, format_replay_json, render_replay_page

    check_output_paths((png, ".png"), (html, ".html"), input_files=list_input_files(logs=[log], tractor=tractor))
    result = simulate(log, tractor=tractor, ground=ground, fixes=fix or ())
    results: list[tuple[Path, OutputContent]] = []
    if png:
        from reports.plan.map_figure import render_png

        results.append((png, render_png(draw_replay(result.replayed))))
    if html:
        results.append((html, render_replay_page(result.replayed, result.remarks)))
    with write_before_printing(results):
        if json:
            typer.echo(format_replay_json(result.replayed, result.remarks), nl=False)
        else:
            from planner.cli.common.terminal import print_renderable

            print_renderable(build_replay_table, result.replayed, result.remarks)
