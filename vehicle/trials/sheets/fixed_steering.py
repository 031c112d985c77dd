"""Sheets of fixed and changing steering (Eq. 2.9, 2.10 and 5.1, Table 4.1, section 4.3.2) and of vehicle design.

Vehicle design (section 6.2) is stability and radius over tyres, and over the position of the centre of mass. A single
drive is at an angle and on a ground that somebody asks for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from fields.arrays import Flags
from fields.errors import mark_parameter
from fields.units import KMH_PER_MPS
from vehicle.errors import VehicleError
from vehicle.model.ground import get_tyres
from vehicle.model.tractor import Tractor, load_tractor
from vehicle.sim.calibration import drive_circle
from vehicle.trials.drive import (
    MAX_GROWTH_DEG,
    MAX_REAR_SLIP_DEG,
    Trace,
    compute_settled_radius,
    drive_by_steering_commands,
    is_sideslip_settled,
    replace_steering,
)
from vehicle.trials.fixed_steering import (
    ANGLES_DEG,
    AXLES,
    BEST_HYPOTHESIS,
    MEASURED_AHEAD_M,
    STUDY_DURATION_S,
    STUDY_RECORD_EVERY,
    STUDY_STEERING_DEG,
    FixedSteeringDrive,
    RadiusMap,
    build_best_hypothesis,
    build_step_commands,
    compute_tyre_maps,
    drive_best_hypothesis_table,
    drive_changing_steering,
    drive_fixed_steering,
    drive_table_4_1,
    move_centre_of_mass,
    sweep_centre_of_mass,
    try_hypotheses,
)
from vehicle.trials.sheets.sheet import (
    TABLE_4_1,
    ExperimentSheet,
    HeatMap,
    PlotLine,
    PlotPanel,
    SteeredDrive,
    TextTable,
    ThesisComparison,
    build_map_panel,
    build_time_panel,
    build_track_line,
)

CIRCLES = (("2.9", "eg105", "asphalt"), ("2.10", "eg105", "soil"), ("5.1", "mr1000a", "soil"))
CIRCLE_ANGLES_DEG = (5, 10, 15, 20, 25, 30, 35)
MIN_DRIVE_S, MAX_DRIVE_S, MAX_SPEED_KMH = 20.0, 3600.0, 30.0
SHOWN_RADII, WIDEST_SHOWN_M = 3.0, 100.0
MAX_CIRCLE_RADIUS_M = 1e6  # a radius beyond this is no circle
CRITERION = (
    f"Oversteer: the slip of the rear axle exceeds {MAX_REAR_SLIP_DEG:g} degrees, or its mean over the last quarter of "
    f"{STUDY_DURATION_S:g} s is more than {MAX_GROWTH_DEG:g} degrees larger than over the quarter before."
)


def build_circles_sheet(tractor: Tractor) -> ExperimentSheet:
    """Turning radii of the corrected base model beside the power laws measured in physical space."""
    rows, lines = [], []
    for number, (equation, name, ground) in enumerate(CIRCLES):
        machine = tractor if name == "eg105" else load_tractor(name)
        radii_by_angle = {
            sign * angle: drive_circle(machine, sign * angle, ground, seconds=30.0).radius_m
            for sign in (1, -1)
            for angle in CIRCLE_ANGLES_DEG
        }
        note = "measured radius 118.4 / (c |delta|^p), to which the model is calibrated"
        for angle, radius in radii_by_angle.items():
            law = machine.get_power_law(ground).compute_radius_m(angle)
            name = f"Eq. {equation} {ground} {'right' if angle > 0 else 'left'} {abs(angle)} deg"
            rows.append(ThesisComparison(name, "turning radius", "m", law, radius, note))
        for sign, side in ((1, "right"), (-1, "left")):
            angles = np.array(CIRCLE_ANGLES_DEG, dtype=float)
            radii = np.array([radii_by_angle[sign * angle] for angle in CIRCLE_ANGLES_DEG])
            label = f"Eq. {equation}, {machine.name} on {ground}, {side}"
            lines.append(PlotLine(label, angles, radii, number, dashed=sign < 0))
    worst = max(abs(row.difference_pct or 0.0) for row in rows)
    words = (
        "The corrected base model is calibrated to the measured radii, so this only checks the calibration. The "
        f"largest difference is {worst:.2f} %.",
    )
    panel = PlotPanel("Turning radius", "Steering angle (degrees)", "Radius (m)", tuple(lines))
    return ExperimentSheet("circles", "Circles at fixed steering (Eq. 2.9, 2.10, 5.1)", words, tuple(rows), (panel,))


def build_fixed_sheet(tractor: Tractor) -> ExperimentSheet:
    """Table 4.1, the plots of Fig. 4.5 and 4.6, and the hypotheses about the non-linear column."""
    drives = drive_table_4_1(tractor)
    plain = drive_table_4_1(tractor, curve=None)
    closest = drive_best_hypothesis_table(tractor)
    used = get_tyres("soil", "linear")
    without_circle = drive_fixed_steering(tractor, used.model_copy(update={"grip": None}))
    rows, radii = [], []
    for drive, bare, guess in zip(drives, plain, closest, strict=True):
        thesis = _get_printed_radius(drive)
        cells = [_format_radius(radius_m) for radius_m in (drive.radius_m, bare.radius_m, guess.radius_m)]
        note = f"without the engine's curve {cells[1]}; closest hypothesis {cells[2]}"
        if thesis is None:
            note = "thesis: oversteer; " + note
        if not drive.stable:
            note = "ours: oversteer; " + note
        name, ours = f"{drive.model} {drive.steering_deg:g} deg", drive.radius_m if drive.stable else None
        rows.append(ThesisComparison(f"4.1 {name}", "turning radius", "m", thesis, ours, note))
        radii.append((name, _format_radius(math.nan if thesis is None else thesis), *cells))
    words = (
        "Tyres of section 4.3: front 0.005 and rear 0.01 of the load per degree, non-linear tyres up to 5 degrees. The "
        "steering is stepped at 5 km/h, without corrected angles.",
        f"Radii belong to a point {MEASURED_AHEAD_M} m ahead of the centre of mass, which reproduces the kinematic "
        "column; at the centre of mass the kinematic radii would be "
        + ", ".join(f"{drive.trace.compute_radius(0.0)[-1]:.2f}" for drive in drives[:3])
        + " m.",
        f"The friction circle of {used.grip:g} of the rear load is assumed; without it the linear column is "
        + ", ".join(_format_radius(drive.radius_m) for drive in without_circle)
        + ".",
        _describe_closest(closest),
    )
    printed = ("thesis", *(f"{value:.2f} m" if value else "oversteer" for value in TABLE_4_1["nonlinear"]))
    guesses = ((guess, *map(_format_radius, radii_m)) for guess, radii_m in try_hypotheses(tractor))
    header = ("Hypothesis, non-linear model", "25 deg", "30 deg", "35 deg")
    columns = ("Drive", "Thesis", "With the curve (used)", "Without", "Closest hypothesis")
    tables = (
        TextTable("Hypotheses about the non-linear column", header, (printed, *guesses)),
        TextTable("Table 4.1 with and without the engine's friction curve", columns, tuple(radii)),
    )
    return ExperimentSheet(
        "fixed", "Fixed steering (Table 4.1)", words, tuple(rows), _build_fixed_panels(drives, closest), tables
    )


def _get_printed_radius(drive: FixedSteeringDrive) -> float | None:
    """The radius (m) of Table 4.1 for the model and angle of a drive; None is oversteer."""
    return dict(zip(ANGLES_DEG, TABLE_4_1[drive.model], strict=True))[drive.steering_deg]


def _format_radius(value: float) -> str:
    return "oversteer" if math.isnan(value) else f"{value:.2f} m"


def _describe_closest(closest: Sequence[FixedSteeringDrive]) -> str:
    pairs = [(drive.radius_m, _get_printed_radius(drive)) for drive in closest]
    worst = max(abs(ours / thesis - 1.0) for ours, thesis in pairs if thesis is not None)
    column = ", ".join(_format_radius(drive.radius_m) for drive in closest[-len(ANGLES_DEG) :])
    return (
        "This setting does not reproduce the non-linear column: the front tyres saturate first and the tractor runs "
        f"wide. The closest hypothesis ({BEST_HYPOTHESIS}) gives {column} there, and the whole table within "
        f"{100.0 * worst:.1f} %. But it fits two numbers to the column and has no engine's curve, which Table 4.3 "
        "needs, so it is not used."
    )


def _build_fixed_panels(
    drives: Sequence[FixedSteeringDrive], closest: Sequence[FixedSteeringDrive]
) -> tuple[PlotPanel, ...]:
    last = closest[-len(ANGLES_DEG) :]
    groups = {
        f"{model.capitalize()} model": [drive for drive in drives if drive.model == model]
        for model in dict.fromkeys(drive.model for drive in drives)
    }
    paths = [
        build_trajectory_panel(title, {f"{drive.steering_deg:g} degrees": drive.trace for drive in group})
        for title, group in (groups | {"Non-linear model, closest hypothesis": last}).items()
    ]
    shown = (("linear model", drives[5]), ("non-linear model", drives[8]), ("closest hypothesis", last[-1]))
    return (*paths, *(build_slip_panel(f"Slip at 35 degrees, {title}", drive.trace) for title, drive in shown))


def build_trajectory_panel(title: str, traces: dict[str, Trace], seconds: float = 30.0) -> PlotPanel:
    """Paths of the centre of mass to scale, each from its own start."""
    places = (trace.compute_path(0.0)[trace.time_s <= seconds] for trace in traces.values())
    lines = [build_track_line(label, place, k) for k, (label, place) in enumerate(zip(traces, places, strict=True))]
    return build_map_panel(title, lines)


def build_slip_panel(title: str, trace: Trace, seconds: float = 15.0) -> PlotPanel:
    """Slip angles of both axles over time."""
    part = trace.time_s <= seconds
    time = trace.time_s[part]
    front, rear = (np.degrees(slip)[part] for slip in trace.compute_slips())
    lines = (PlotLine("front axle", time, front, 0), PlotLine("rear axle", time, rear, 1))
    return build_time_panel(title, "Slip angle (degrees)", lines)


def build_changing_sheet(tractor: Tractor) -> ExperimentSheet:
    """Section 4.3.2: the steering is a sine; Fig. 4.7 is lost, so 35 degrees and 20 s are assumed."""
    traces = drive_changing_steering(tractor)
    first = next(iter(traces.values()))
    steering = PlotLine("all models", first.time_s, np.degrees(first.get_column("steering")), 0)
    slips = {model: np.degrees(np.abs(track.compute_slips()[1])).max() for model, track in traces.items()}
    spread = "; ".join(f"{model} {largest:.1f} degrees" for model, largest in slips.items())
    words = (
        "The steering swings between 35 degrees right and left with a period of 20 s (assumed; the figure is lost).",
        f"Largest slip of the rear axle: {spread}.",
    )
    panels = (
        build_time_panel("Steering", "Angle (degrees)", (steering,)),
        *(
            build_trajectory_panel(f"{model.capitalize()} model", {model: track}, 80.0)
            for model, track in traces.items()
        ),
    )
    return ExperimentSheet("changing", "Continuously changing steering (section 4.3.2)", words, (), panels)


def build_tyres_sheet(tractor: Tractor) -> ExperimentSheet:
    """Fig. 6.2: where the tractor is stable, and its radius, over front and rear tyres."""
    maps_here = compute_tyre_maps(tractor)
    sagging, closest = build_best_hypothesis(tractor)
    maps_of_hypothesis = compute_tyre_maps(sagging, tyres=closest, shared_limit=True)
    tests: tuple[tuple[str, Callable[[RadiusMap, RadiusMap], bool]], ...] = (
        ("Rear grip decides stability: stable with more grip at the rear",
         lambda _, rear: _is_stable_above_threshold(rear.stable)),
        ("Front grip must be small: stable with less grip at the front",
         lambda front, _: _is_stable_above_threshold(front.stable[::-1, ::-1])),
        ("Front grip decides the radius: it varies more than twofold",
         lambda front, _: _compute_radius_ratio(front) > 2.0),
        ("Rear grip hardly changes the radius: within 10 %", lambda _, rear: _compute_radius_ratio(rear) < 1.1),
        ("The radius is inversely proportional to k and alpha_0 of the front tyres, within 15 %",
         lambda front, _: _is_radius_inverse_to_tyres(front)),
        ("The fixed pair itself oversteers at 35 degrees",
         lambda front, _: not front.stable[front.rows.index(0.005), front.columns.index(5.0)]),
    )  # fmt: skip
    statements = _build_statement_table(
        "Statement of section 6.2.1", ((text, test(*maps_here), test(*maps_of_hypothesis)) for text, test in tests)
    )
    counts = "; ".join(
        f"{name}: {int(front.stable.sum())} front and {int(rear.stable.sum())} rear tyres of {rear.stable.size}"
        for name, (front, rear) in (("stable here", maps_here), ("with the closest hypothesis", maps_of_hypothesis))
    )
    words = (
        f"{STUDY_STEERING_DEG:g} degrees at 5 km/h on the tyres of section 4.3 (fixed axle: front 5 degrees and 0.005, "
        "rear 5 degrees and 0.01), with the engine's friction curve. Radii belong to the centre of mass.",
        CRITERION,
        f"{counts[0].upper()}{counts[1:]}.",
        f"The closest hypothesis about Table 4.1: {BEST_HYPOTHESIS}.",
    )
    labels = "alpha_0 (degrees)", "k (per degree)", "Turning radius (m)"
    grid = np.array(maps_here[0].columns), np.array(maps_here[0].rows)
    maps = tuple(
        HeatMap(f"{axle.capitalize()} tyres, {title}", *labels, *grid, tyre_map.radius_m, "oversteer")
        for title, pair in (("the other axle fixed", maps_here), ("closest hypothesis", maps_of_hypothesis))
        for axle, tyre_map in zip(AXLES, pair, strict=True)
    )
    return ExperimentSheet("tyres", "Tyres (Fig. 6.2)", words, (), maps, (statements,))


def _build_statement_table(head: str, outcomes: Iterable[tuple[str, bool, bool]]) -> TextTable:
    """Statements of the thesis, and whether they are confirmed here and with the closest hypothesis."""
    words = {True: "confirmed", False: "not confirmed"}
    rows = tuple((text, words[here], words[closest]) for text, here, closest in outcomes)
    return TextTable("Statements", (head, "Here", "Closest hypothesis"), rows)


def _is_stable_above_threshold(stable: Flags) -> bool:
    """Whether cells with a larger slope or limit than a stable one are stable, and some cells are unstable."""
    rows = (stable[1:] >= stable[:-1]).all() and (stable[:, 1:] >= stable[:, :-1]).all()
    return bool(rows and stable.any() and not stable.all())


def _compute_radius_ratio(tyre_map: RadiusMap) -> float:
    radii = tyre_map.radius_m[tyre_map.stable]
    return float(radii.max() / radii.min()) if len(radii) else np.nan


def _is_radius_inverse_to_tyres(tyre_map: RadiusMap) -> bool:
    """Whether radius times slope times limit is the same over all stable cells, within 15 %."""
    product = (np.outer(tyre_map.rows, tyre_map.columns) * tyre_map.radius_m)[tyre_map.stable]
    return bool(len(product) and np.abs(product / np.median(product) - 1.0).max() < 0.15)


def build_mass_sheet(tractor: Tractor) -> ExperimentSheet:
    """Fig. 6.3: radius and stability over the position of the centre of mass."""
    sweep_here = sweep_centre_of_mass(tractor)
    sagging, closest = build_best_hypothesis(tractor)
    sweep_of_hypothesis = sweep_centre_of_mass(sagging, tyres=closest)
    tests: tuple[tuple[str, Callable[[RadiusMap], bool]], ...] = (
        ("A centre of mass further back stabilises: no position behind a stable one is unstable",
         lambda sweep: bool((sweep.stable[:, 1:] >= sweep.stable[:, :-1]).all() and sweep.stable.any())),
        ("At 25 degrees every position is stable", lambda sweep: bool(sweep.stable[0].all())),
        ("At 30 degrees only the foremost positions are unstable", _is_front_unstable),
        ("At 35 degrees every position is unstable", lambda sweep: not sweep.stable[2].any()),
        ("At 25 degrees the radius falls as the centre of mass moves back", _has_falling_radius),
    )  # fmt: skip
    statements = _build_statement_table(
        "Statement of section 6.2.2", ((text, test(sweep_here), test(sweep_of_hypothesis)) for text, test in tests)
    )
    words = (
        "Tyres of section 4.3 (front 5 degrees and 0.005, rear 5 degrees and 0.01) at 5 km/h. The range of positions "
        "is not printed. Radii belong to the centre of mass; a cross at the lower edge is an unstable position.",
        CRITERION,
        f"The second column repeats the sweep with the closest hypothesis about Table 4.1: {BEST_HYPOTHESIS}.",
    )
    panels = (
        _build_radius_panel("Radius over the centre of mass", sweep_here),
        _build_radius_panel("The same with the closest hypothesis", sweep_of_hypothesis),
        _build_path_panel("Paths at 35 degrees", sweep_here),
        _build_path_panel("Paths at 35 degrees, closest hypothesis", sweep_of_hypothesis),
    )
    header = ("Behind the front axle", *(f"{angle:g} deg" for angle in sweep_here.rows))
    rows = []
    for column, place in enumerate(sweep_here.columns):
        cells = ["oversteer" if np.isnan(radius) else f"{radius:.2f} m" for radius in sweep_here.radius_m[:, column]]
        rows.append((f"{place:.1f} m", *cells))
    tables = statements, TextTable("Turning radius", header, tuple(rows))
    return ExperimentSheet("mass", "Centre of mass (Fig. 6.3)", words, (), panels, tables)


def _is_front_unstable(sweep: RadiusMap) -> bool:
    """Whether positions are unstable up to some position in the front half, and stable from there on."""
    stable = sweep.stable[1]
    return bool(not stable[0] and stable[len(stable) // 2 :].all() and (stable[1:] >= stable[:-1]).all())


def _has_falling_radius(sweep: RadiusMap) -> bool:
    radii = sweep.radius_m[0][sweep.stable[0]]
    return bool(len(radii) > 1 and (np.diff(radii) < 0.0).all())


def _build_radius_panel(title: str, sweep: RadiusMap) -> PlotPanel:
    lines = tuple(
        PlotLine(f"{angle:g} degrees", np.array(sweep.columns), radii, number)
        for number, (angle, radii) in enumerate(zip(sweep.rows, sweep.radius_m, strict=True))
    )
    labels = "Centre of mass behind the front axle (m)", "Turning radius (m)"
    return PlotPanel(title, *labels, lines, missing="oversteer")


def _build_path_panel(title: str, sweep: RadiusMap) -> PlotPanel:
    last = sweep.traces[-len(sweep.columns) :]
    traces = {f"{sweep.columns[index]:.1f} m": last[index] for index in (0, 3, 6, 10)}
    return build_trajectory_panel(title, traces, math.inf)


@dataclass(frozen=True)
class SteeredDriveRequest:
    """The request for a steered drive. Steering in degrees, positive to the right; `mass_m` is the distance of the
    centre of mass behind the front axle.
    """

    steer_deg: float
    ground: str = "asphalt"
    model: str = "nonlinear"
    seconds: float = 60.0
    speed_kmh: float = 5.0
    tractor: str = "eg105"
    steering: str = "none"
    mass_m: float | None = None


def run_steered_drive(request: SteeredDriveRequest) -> tuple[SteeredDrive, Trace]:
    """The result of the drive, and the whole trace for plots.

    Raises VehicleError for a request that cannot be driven.
    """
    values = {"steer_deg": request.steer_deg, "seconds": request.seconds, "speed_kmh": request.speed_kmh}
    for name, value in values.items():
        if not math.isfinite(value):
            raise VehicleError(f"{mark_parameter(name)} is {value}; give a number.")
    if not MIN_DRIVE_S <= request.seconds <= MAX_DRIVE_S:
        raise VehicleError(
            f"{mark_parameter('seconds')} is {request.seconds:g}; use {MIN_DRIVE_S:g} to {MAX_DRIVE_S:g}."
        )
    if not 0 < request.speed_kmh <= MAX_SPEED_KMH:
        raise VehicleError(
            f"{mark_parameter('speed_kmh')} is {request.speed_kmh:g}; use a speed above 0 and up to {MAX_SPEED_KMH:g}."
        )
    tractor = load_tractor(request.tractor)
    if request.mass_m is not None:
        tractor = move_centre_of_mass(tractor, request.mass_m)
    tractors, tyres = [replace_steering(tractor, request.steering)], [get_tyres(request.ground, request.model)]
    commands, speed_mps = build_step_commands([request.steer_deg], request.seconds), request.speed_kmh / KMH_PER_MPS
    (trace,) = drive_by_steering_commands(
        tractors, tyres, commands, speed_mps=speed_mps, record_every=STUDY_RECORD_EVERY
    )
    radius = compute_settled_radius(trace, trace.point_m)
    front, rear = (float(np.degrees(slip[-1])) for slip in trace.compute_slips())
    circle = math.isfinite(radius) and radius < MAX_CIRCLE_RADIUS_M
    heading, wheels = (90.0 - np.degrees(trace.get_column("angle"))) % 360.0, np.degrees(trace.get_column("steering"))
    rows = np.column_stack([trace.time_s, trace.compute_path(), heading, wheels])
    return SteeredDrive(radius if circle else None, is_sideslip_settled(trace), front, rear, rows), trace


def build_drive_sheet(request: SteeredDriveRequest, driven: SteeredDrive, trace: Trace) -> ExperimentSheet:
    """The drive in words and plots."""
    seconds = float(trace.time_s[-1])
    radius = trace.compute_radius()
    # Up to so many metres that the circle fills the plot.
    limit_m = SHOWN_RADII * driven.radius_m if driven.stable and driven.radius_m else WIDEST_SHOWN_M
    shown = np.where(radius < limit_m, radius, np.nan)
    wheels = np.degrees(trace.get_column("steering"))
    panels = (
        build_trajectory_panel("Path of the centre of mass", {f"{request.steer_deg:g} degrees": trace}, seconds),
        build_slip_panel("Slip angles", trace, seconds),
        build_time_panel("Wheel angle", "Angle (degrees)", (PlotLine("wheel angle", trace.time_s, wheels, 0),)),
        build_time_panel("Momentary turning radius", "Radius (m)", (PlotLine("radius", trace.time_s, shown, 0),)),
    )
    title = f"{request.steer_deg:g} degrees on {request.ground}, {request.model} tyres, {request.speed_kmh:g} km/h"
    words = describe_drive(driven), "The wheels are stepped after one second at speed."
    return ExperimentSheet("drive", title, words, (), panels)


def describe_drive(driven: SteeredDrive) -> str:
    """The result in one sentence."""
    slips = f"slip {driven.slip_front_deg:.2f} degrees at the front axle and {driven.slip_rear_deg:.2f} at the rear"
    if not driven.stable:
        return f"Oversteer: the side-slip does not settle; at the end {slips}."
    if driven.radius_m is None:
        return f"Straight on; {slips}."
    return f"A steady circle of {driven.radius_m:.2f} m radius (antenna); {slips}."
