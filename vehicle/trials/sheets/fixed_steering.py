"""Sheets of fixed and changing steering (Eq. 2.9, 2.10 and 5.1, Table 4.1, section 4.3.2) and of vehicle design.

Vehicle design (section 6.2) is stability and radius over tyres, and over the position of the centre of mass.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from vehicle.model.ground import get_tyres
from vehicle.model.tractor import Tractor, load_tractor
from vehicle.sim.calibration import drive_circle
from vehicle.trials.drive import MAX_GROWTH_DEG, MAX_REAR_SLIP_DEG, Trace
from vehicle.trials.fixed_steering import (
    ANGLES_DEG,
    BEST_HYPOTHESIS,
    MEASURED_AHEAD_M,
    STUDY_DURATION_S,
    STUDY_STEERING_DEG,
    CentreOfMassSweep,
    FixedSteeringDrive,
    TyreHypothesis,
    TyreMap,
    build_best_hypothesis,
    compute_tyre_maps,
    drive_best_hypothesis_table,
    drive_changing_steering,
    drive_fixed_steering,
    drive_table_4_1,
    sweep_centre_of_mass,
    try_hypotheses,
)
from vehicle.trials.sheets.sheet import (
    TABLE_4_1,
    ExperimentSheet,
    HeatMap,
    PlotLine,
    PlotPanel,
    TextTable,
    ThesisComparison,
)

CIRCLES = (("2.9", "eg105", "asphalt"), ("2.10", "eg105", "soil"), ("5.1", "mr1000a", "soil"))
CIRCLE_ANGLES_DEG = (5, 10, 15, 20, 25, 30, 35)
SHOWN_S = 30.0


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
        for angle, radius in radii_by_angle.items():
            law = machine.get_power_law(ground).compute_radius_m(angle)
            side = "right" if angle > 0 else "left"
            rows.append(
                ThesisComparison(
                    f"Eq. {equation} {ground} {side} {abs(angle)} deg",
                    "turning radius",
                    "m",
                    law,
                    radius,
                    "measured radius 118.4 / (c |delta|^p), to which the model is calibrated",
                )
            )
        for sign, dashed in ((1, False), (-1, True)):
            radii = np.array([radii_by_angle[sign * angle] for angle in CIRCLE_ANGLES_DEG])
            side = "right" if sign > 0 else "left"
            lines.append(
                PlotLine(
                    f"Eq. {equation}, {machine.name} on {ground}, {side}",
                    np.array(CIRCLE_ANGLES_DEG, dtype=float),
                    radii,
                    number,
                    dashed,
                )
            )
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
    hypotheses = try_hypotheses(tractor)
    closest = drive_best_hypothesis_table(tractor)
    used = get_tyres("soil", "linear")
    without_circle = drive_fixed_steering(tractor, used.model_copy(update={"grip": None}))
    rows = [_build_radius_row(*trio) for trio in zip(drives, plain, closest, strict=True)]
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
    tables = (_build_hypothesis_table(hypotheses), _build_friction_curve_table(drives, plain, closest))
    return ExperimentSheet(
        "fixed", "Fixed steering (Table 4.1)", words, tuple(rows), _build_fixed_panels(drives, closest), tables
    )


def _build_radius_row(
    drive: FixedSteeringDrive, bare: FixedSteeringDrive, closest: FixedSteeringDrive
) -> ThesisComparison:
    thesis = TABLE_4_1[drive.model][ANGLES_DEG.index(drive.steering_deg)]
    bare_text, closest_text = _format_radius(bare.radius_m), _format_radius(closest.radius_m)
    note = f"without the engine's curve {bare_text}; closest hypothesis {closest_text}"
    if thesis is None:
        note = "thesis: oversteer; " + note
    if not drive.stable:
        note = "ours: oversteer; " + note
    ours = drive.radius_m if drive.stable else None
    return ThesisComparison(f"4.1 {drive.model} {drive.steering_deg:g} deg", "turning radius", "m", thesis, ours, note)


def _format_radius(value: float) -> str:
    return "oversteer" if math.isnan(value) else f"{value:.2f} m"


def _describe_closest(closest: Sequence[FixedSteeringDrive]) -> str:
    pairs = [(drive.radius_m, TABLE_4_1[drive.model][ANGLES_DEG.index(drive.steering_deg)]) for drive in closest]
    worst = max(abs(ours / thesis - 1.0) for ours, thesis in pairs if thesis is not None)
    column = ", ".join(_format_radius(drive.radius_m) for drive in closest[-len(ANGLES_DEG) :])
    return (
        "This setting does not reproduce the non-linear column: the front tyres saturate first and the tractor runs "
        f"wide. The closest hypothesis ({BEST_HYPOTHESIS}) gives {column} there, and the whole table within "
        f"{100.0 * worst:.1f} %. But it fits two numbers to the column and has no engine's curve, which Table 4.3 "
        "needs, so it is not used."
    )


def _build_hypothesis_table(hypotheses: Sequence[TyreHypothesis]) -> TextTable:
    thesis = ("thesis", *(f"{v:.2f} m" if v else "oversteer" for v in TABLE_4_1["nonlinear"]))
    rows = tuple((guess.words, *(_format_radius(value) for value in guess.radii_m)) for guess in hypotheses)
    header = ("Hypothesis, non-linear model", "25 deg", "30 deg", "35 deg")
    return TextTable("Hypotheses about the non-linear column", header, (thesis, *rows))


def _build_friction_curve_table(
    drives: Sequence[FixedSteeringDrive], plain: Sequence[FixedSteeringDrive], closest: Sequence[FixedSteeringDrive]
) -> TextTable:
    rows = []
    for trio in zip(drives, plain, closest, strict=True):
        used = trio[0]
        thesis = TABLE_4_1[used.model][ANGLES_DEG.index(used.steering_deg)]
        shown = _format_radius(math.nan if thesis is None else thesis)
        rows.append(
            (f"{used.model} {used.steering_deg:g} deg", shown, *(_format_radius(drive.radius_m) for drive in trio))
        )
    header = ("Drive", "Thesis", "With the curve (used)", "Without", "Closest hypothesis")
    return TextTable("Table 4.1 with and without the engine's friction curve", header, tuple(rows))


def _build_fixed_panels(
    drives: Sequence[FixedSteeringDrive], closest: Sequence[FixedSteeringDrive]
) -> tuple[PlotPanel, ...]:
    panels = []
    for model in dict.fromkeys(drive.model for drive in drives):
        of_model = [drive for drive in drives if drive.model == model]
        panels.append(
            build_trajectory_panel(f"{model.capitalize()} model", {_format_angle(d): d.trace for d in of_model})
        )
    last = closest[-len(ANGLES_DEG) :]
    panels.append(
        build_trajectory_panel("Non-linear model, closest hypothesis", {_format_angle(d): d.trace for d in last})
    )
    shown = (("linear model", drives[5]), ("non-linear model", drives[8]), ("closest hypothesis", last[-1]))
    for title, drive in shown:
        panels.append(build_slip_panel(f"Slip at 35 degrees, {title}", drive.trace))
    return tuple(panels)


def _format_angle(drive: FixedSteeringDrive) -> str:
    return f"{drive.steering_deg:g} degrees"


def build_trajectory_panel(title: str, traces: dict[str, Trace], seconds: float = SHOWN_S) -> PlotPanel:
    """Paths of the centre of mass to scale, each from its own start."""
    lines = []
    for number, (label, track) in enumerate(traces.items()):
        place = track.compute_path(0.0)[track.time_s <= seconds]
        lines.append(PlotLine(label, place[:, 0] - place[0, 0], place[:, 1] - place[0, 1], number))
    return PlotPanel(title, "East (m)", "North (m)", tuple(lines), equal_axes=True)


def build_slip_panel(title: str, trace: Trace, seconds: float = 15.0) -> PlotPanel:
    """Slip angles of both axles over time."""
    part = trace.time_s <= seconds
    time = trace.time_s[part]
    front, rear = (np.degrees(slip)[part] for slip in trace.compute_slips())
    lines = (PlotLine("front axle", time, front, 0), PlotLine("rear axle", time, rear, 1))
    return PlotPanel(title, "Time (s)", "Slip angle (degrees)", lines)


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
        PlotPanel("Steering", "Time (s)", "Angle (degrees)", (steering,)),
        *(
            build_trajectory_panel(f"{model.capitalize()} model", {model: track}, 80.0)
            for model, track in traces.items()
        ),
    )
    return ExperimentSheet("changing", "Continuously changing steering (section 4.3.2)", words, (), panels)


CRITERION = (
    f"Oversteer: the slip of the rear axle exceeds {MAX_REAR_SLIP_DEG:g} degrees, or its mean over the last quarter of "
    f"{STUDY_DURATION_S:g} s is more than {MAX_GROWTH_DEG:g} degrees larger than over the quarter before."
)


def build_tyres_sheet(tractor: Tractor) -> ExperimentSheet:
    """Fig. 6.2: where the tractor is stable, and its radius, over front and rear tyres."""
    maps_here = compute_tyre_maps(tractor)
    sagging, closest = build_best_hypothesis(tractor)
    maps_of_hypothesis = compute_tyre_maps(sagging, tyres=closest, shared_limit=True)
    tests: tuple[tuple[str, Callable[[TyreMap, TyreMap], bool]], ...] = (
        (
            "Rear grip decides stability: stable with more grip at the rear",
            lambda _, rear: _is_stable_above_threshold(rear),
        ),
        (
            "Front grip must be small: stable with less grip at the front",
            lambda front, _: _is_stable_below_threshold(front),
        ),
        (
            "Front grip decides the radius: it varies more than twofold",
            lambda front, _: _compute_radius_ratio(front) > 2.0,
        ),
        ("Rear grip hardly changes the radius: within 10 %", lambda _, rear: _compute_radius_ratio(rear) < 1.1),
        (
            "The radius is inversely proportional to k and alpha_0 of the front tyres, within 15 %",
            lambda front, _: _is_radius_inverse_to_tyres(front),
        ),
        ("The fixed pair itself oversteers at 35 degrees", lambda front, _: not _is_fixed_pair_stable(front)),
    )
    rows = tuple(
        (text, _format_outcome(test(*maps_here)), _format_outcome(test(*maps_of_hypothesis))) for text, test in tests
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
    maps = tuple(
        _build_heat_map(tyre_map, f"{tyre_map.axle.capitalize()} tyres, {title}")
        for title, pair in (("the other axle fixed", maps_here), ("closest hypothesis", maps_of_hypothesis))
        for tyre_map in pair
    )
    header = ("Statement of section 6.2.1", "Here", "Closest hypothesis")
    return ExperimentSheet("tyres", "Tyres (Fig. 6.2)", words, (), maps, (TextTable("Statements", header, rows),))


def _build_heat_map(tyre_map: TyreMap, title: str) -> HeatMap:
    x, y = np.array(tyre_map.limits_deg), np.array(tyre_map.slopes_per_deg)
    names = ("alpha_0 (degrees)", "k (per degree)", "Turning radius (m)")
    return HeatMap(title, *names, x, y, tyre_map.radius_m, "oversteer")


def _is_fixed_pair_stable(front: TyreMap) -> bool:
    """Whether the tyres of section 4.3 are stable together."""
    return bool(front.stable[front.slopes_per_deg.index(0.005), front.limits_deg.index(5.0)])


def _is_stable_above_threshold(tyre_map: TyreMap) -> bool:
    """Whether cells with a larger slope or limit than a stable one are stable, and some cells are unstable."""
    stable = tyre_map.stable
    rows = (stable[1:] >= stable[:-1]).all() and (stable[:, 1:] >= stable[:, :-1]).all()
    return bool(rows and stable.any() and not stable.all())


def _is_stable_below_threshold(tyre_map: TyreMap) -> bool:
    stable = tyre_map.stable
    rows = (stable[1:] <= stable[:-1]).all() and (stable[:, 1:] <= stable[:, :-1]).all()
    return bool(rows and stable.any() and not stable.all())


def _compute_radius_ratio(tyre_map: TyreMap) -> float:
    radii = tyre_map.radius_m[tyre_map.stable]
    return float(radii.max() / radii.min()) if len(radii) else np.nan


def _is_radius_inverse_to_tyres(tyre_map: TyreMap) -> bool:
    """Whether radius times slope times limit is the same over all stable cells, within 15 %."""
    product = (np.outer(tyre_map.slopes_per_deg, tyre_map.limits_deg) * tyre_map.radius_m)[tyre_map.stable]
    return bool(len(product) and np.abs(product / np.median(product) - 1.0).max() < 0.15)


def build_mass_sheet(tractor: Tractor) -> ExperimentSheet:
    """Fig. 6.3: radius and stability over the position of the centre of mass."""
    sweep_here = sweep_centre_of_mass(tractor)
    sagging, closest = build_best_hypothesis(tractor)
    sweep_of_hypothesis = sweep_centre_of_mass(sagging, tyres=closest)
    rows = tuple(
        (text, _format_outcome(test(sweep_here)), _format_outcome(test(sweep_of_hypothesis)))
        for text, test in (
            (
                "A centre of mass further back stabilises: no position behind a stable one is unstable",
                _is_stabilised_by_rear,
            ),
            ("At 25 degrees every position is stable", lambda sweep: bool(np.isfinite(sweep.radius_m[0]).all())),
            ("At 30 degrees only the foremost positions are unstable", _is_front_unstable),
            ("At 35 degrees every position is unstable", lambda sweep: bool(np.isnan(sweep.radius_m[2]).all())),
            ("At 25 degrees the radius falls as the centre of mass moves back", _has_falling_radius),
        )
    )
    words = (
        "Tyres of section 4.3 (front 5 degrees and 0.005, rear 5 degrees and 0.01) at 5 km/h. The range of positions "
        "is not printed. Radii belong to the centre of mass; a cross at the lower edge is an unstable position.",
        CRITERION,
        f"The second column repeats the sweep with the closest hypothesis about Table 4.1: {BEST_HYPOTHESIS}.",
    )
    header = ("Statement of section 6.2.2", "Here", "Closest hypothesis")
    panels = (
        _build_radius_panel("Radius over the centre of mass", sweep_here),
        _build_radius_panel("The same with the closest hypothesis", sweep_of_hypothesis),
        _build_path_panel("Paths at 35 degrees", sweep_here),
        _build_path_panel("Paths at 35 degrees, closest hypothesis", sweep_of_hypothesis),
    )
    table = TextTable("Statements", header, rows)
    return ExperimentSheet(
        "mass", "Centre of mass (Fig. 6.3)", words, (), panels, (table, _build_radius_table(sweep_here))
    )


def _format_outcome(good: bool) -> str:
    return "confirmed" if good else "not confirmed"


def _is_stabilised_by_rear(sweep: CentreOfMassSweep) -> bool:
    stable = np.isfinite(sweep.radius_m)
    return bool((stable[:, 1:] >= stable[:, :-1]).all() and stable.any())


def _is_front_unstable(sweep: CentreOfMassSweep) -> bool:
    """Whether positions are unstable up to some position in the front half, and stable from there on."""
    stable = np.isfinite(sweep.radius_m[1])
    return bool(not stable[0] and stable[len(stable) // 2 :].all() and (stable[1:] >= stable[:-1]).all())


def _has_falling_radius(sweep: CentreOfMassSweep) -> bool:
    radii = sweep.radius_m[0][np.isfinite(sweep.radius_m[0])]
    return bool(len(radii) > 1 and (np.diff(radii) < 0.0).all())


def _build_radius_panel(title: str, sweep: CentreOfMassSweep) -> PlotPanel:
    lines = tuple(
        PlotLine(f"{angle:g} degrees", np.array(sweep.front_axle_m), radii, number)
        for number, (angle, radii) in enumerate(zip(sweep.angles_deg, sweep.radius_m, strict=True))
    )
    return PlotPanel(
        title, "Centre of mass behind the front axle (m)", "Turning radius (m)", lines, missing="oversteer"
    )


def _build_path_panel(title: str, sweep: CentreOfMassSweep) -> PlotPanel:
    lines = []
    for number, index in enumerate((0, 3, 6, 10)):
        track = sweep.traces[index]
        place = track.compute_path(0.0)
        label = f"{sweep.front_axle_m[index]:.1f} m"
        lines.append(PlotLine(label, place[:, 0] - place[0, 0], place[:, 1] - place[0, 1], number))
    return PlotPanel(title, "East (m)", "North (m)", tuple(lines), equal_axes=True)


def _build_radius_table(sweep: CentreOfMassSweep) -> TextTable:
    header = ("Behind the front axle", *(f"{angle:g} deg" for angle in sweep.angles_deg))
    rows = []
    for column, place in enumerate(sweep.front_axle_m):
        cells = ["oversteer" if np.isnan(radius) else f"{radius:.2f} m" for radius in sweep.radius_m[:, column]]
        rows.append((f"{place:.1f} m", *cells))
    return TextTable("Turning radius", header, tuple(rows))
