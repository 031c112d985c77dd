"""`headland drive`, `design`, `study` and `validate`: single drives, design sweeps and the numbers of the thesis."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from fields.errors import suggest_name
from planner.cli.common.options import AsJson, ForceOption, Html, Png, TractorOption
from planner.cli.common.outputs import check_output_paths, list_input_files, write_before_printing
from planner.cli.common.terminal import AnswerForm, create_progress_callback, warm_up
from planner.errors import RequestError
from vehicle.errors import VehicleError

if TYPE_CHECKING:
    from vehicle.model.tractor import Tractor
    from vehicle.trials.sheets.sheet import ExperimentSheet

EXPERIMENTS = ("circles", "step", "zigzag", "navigation", "fixed", "changing", "slip", "twin")
STUDIES = ("tyres", "mass")


def design(
    study: Annotated[str, typer.Argument(help="tyres (Fig. 6.2) or mass (Fig. 6.3).")],
    tractor: TractorOption = "eg105",
    html: Html = None,
    png: Png = None,
    force: ForceOption = False,
    json: AsJson = False,
) -> None:
    """Sweep tyres or the centre of mass: where the tractor is stable at 35 degrees, and how tightly it turns.

    Example: headland design tyres --html tyres.html
    """
    from reports.trials.report import format_experiment_json
    from vehicle.model.tractor import load_tractor
    from vehicle.trials.sheets.fixed_steering import build_mass_sheet, build_tyres_sheet

    check_output_paths((html, ".html"), (png, ".png"), input_files=list_input_files({"tractor": tractor}), force=force)
    if study not in STUDIES:
        close, known = suggest_name(study, STUDIES), ", ".join(STUDIES)
        raise VehicleError(f"The study {study!r} is unknown{close}; use one of: {known}.")
    warm_up()
    build_sheet = build_tyres_sheet if study == "tyres" else build_mass_sheet
    sheet = build_sheet(load_tractor(tractor))
    print_experiments((sheet,), html, png, AnswerForm(json), sheet, json=format_experiment_json)


def drive(
    steer: Annotated[float, typer.Option(help="Steering angle, degrees, positive to the right.")],
    ground: Annotated[str, typer.Option(help="asphalt, soil or mud.")] = "asphalt",
    model: Annotated[str, typer.Option(help="Tyre model: kinematic, linear or nonlinear.")] = "nonlinear",
    seconds: Annotated[float, typer.Option(help="Length of the drive, seconds.")] = 60.0,
    speed_kmh: Annotated[float, typer.Option(help="Speed, km/h.")] = 5.0,
    tractor: TractorOption = "eg105",
    steering: Annotated[str, typer.Option(help="Steering simulator: none, proposed, traditional, unlatched.")] = "none",
    mass: Annotated[Optional[float], typer.Option(help="Centre of mass, metres behind the front axle.")] = None,
    html: Html = None,
    png: Png = None,
    force: ForceOption = False,
    json: AsJson = False,
) -> None:
    """Drive with the wheels at a fixed angle on the tyres of chapter 4: radius, stability, side-slip.

    Example: headland drive --steer 25 --ground mud --model nonlinear --png circle.png
    """
    from reports.trials.report import format_drive_json
    from vehicle.trials.sheets.fixed_steering import (
        SteeredDriveRequest,
        build_drive_sheet,
        describe_drive,
        run_steered_drive,
    )

    check_output_paths((html, ".html"), (png, ".png"), input_files=list_input_files({"tractor": tractor}), force=force)
    request = SteeredDriveRequest(steer, ground, model, seconds, speed_kmh, tractor, steering, mass)
    warm_up()
    result, path = run_steered_drive(request)
    sheets = (build_drive_sheet(request, result, path),) if html or png else ()
    print_experiments(sheets, html, png, AnswerForm(json), result, json=format_drive_json, screen=describe_drive)


def study(json: AsJson = False) -> None:
    """Simulate Tables 6.1, 6.2 and 6.3 of the thesis, compare the times, and judge its claims.

    Example: headland study --json
    """
    from planner.pipeline.thesis_study import study as simulate
    from reports.trials.report import build_study_tables, format_study_json

    warm_up()
    with create_progress_callback("Simulating the study") as progress:
        result = simulate(progress=progress)
    AnswerForm(json).print_answer(result, json=format_study_json, screen=build_study_tables)


def validate(
    experiment: Annotated[
        Optional[str],
        typer.Argument(help="circles, step, zigzag, navigation, fixed, changing, slip or twin; by default all."),
    ] = None,
    html: Html = None,
    png: Annotated[Optional[Path], typer.Option(help="Write the pictures of one experiment.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the GNSS errors.")] = 1,
    force: ForceOption = False,
    json: AsJson = False,
) -> None:
    """Repeat the experiments of chapters 3 to 5 of the thesis and print every number beside that of the thesis.

    Example: headland validate zigzag --html zigzag.html
    """
    from reports.trials.report import format_trials_json

    check_output_paths((html, ".html"), (png, ".png"), force=force)
    known = ", ".join(EXPERIMENTS)
    if experiment is not None and experiment not in EXPERIMENTS:
        close = suggest_name(experiment, EXPERIMENTS)
        raise VehicleError(f"The experiment {experiment!r} is unknown{close}; use one of: {known}.")
    if experiment is None and png is not None:
        raise RequestError(f"--png shows one experiment; name one of: {', '.join(EXPERIMENTS)}.")
    if seed < 0:
        raise RequestError(f"--seed is {seed}; use 0 or more.")
    warm_up()
    with create_progress_callback("Running the experiments") as progress:
        names = EXPERIMENTS if experiment is None else (experiment,)
        sheets = run_experiments(names, seed=seed, progress=progress)
    print_experiments(sheets, html, png, AnswerForm(json), sheets, json=format_trials_json)


def run_experiments(
    names: tuple[str, ...] = EXPERIMENTS, *, seed: int = 1, progress: Callable[[int, int], None] | None = None
) -> tuple[ExperimentSheet, ...]:
    """Run experiments with the thesis's tractor, in the order given."""
    from vehicle.model.tractor import load_tractor
    from vehicle.trials.sheets.fixed_steering import build_changing_sheet, build_circles_sheet, build_fixed_sheet
    from vehicle.trials.sheets.path_following import (
        build_navigation_sheet,
        build_slip_sheet,
        build_step_sheet,
        build_zigzag_sheet,
    )
    from vehicle.trials.sheets.twin_link import build_twin_sheet

    tractor = load_tractor("eg105")
    runs: dict[str, Callable[[Tractor], ExperimentSheet]] = {
        "circles": build_circles_sheet,
        "step": lambda machine: build_step_sheet(machine, seed),
        "zigzag": build_zigzag_sheet,
        "navigation": lambda machine: build_navigation_sheet(machine, seed),
        "fixed": build_fixed_sheet,
        "changing": build_changing_sheet,
        "slip": build_slip_sheet,
        "twin": lambda machine: build_twin_sheet(machine, seed),
    }
    sheets = []
    for number, name in enumerate(names):
        sheets.append(runs[name](tractor))
        if progress:
            progress(number + 1, len(names))
    return tuple(sheets)


def print_experiments(
    sheets: tuple[ExperimentSheet, ...],
    html: Path | None,
    png: Path | None,
    form: AnswerForm,
    *answers: Any,
    json: Callable[..., str],
    screen: Callable[..., object] | None = None,
) -> None:
    """Write the requested page of some experiments and picture of the first, then print them or what is given."""
    from reports.plan.map_figure import render_png
    from reports.trials.report import build_trials_table, draw_experiment_panels, render_trials_page

    with write_before_printing(
        (html, lambda: render_trials_page(sheets)), (png, lambda: render_png(draw_experiment_panels(sheets[0])))
    ):
        form.print_answer(*answers, json=json, screen=screen or (lambda *_: build_trials_table(sheets)))
