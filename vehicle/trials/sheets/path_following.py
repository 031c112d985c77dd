"""Sheets of experiments along paths: zigzag (section 3.3), navigation (Table 3.4), asphalt and mud (Table 4.3)."""

from __future__ import annotations

import math

import numpy as np

from vehicle.control.steering import SLEW
from vehicle.model.gnss import load_default_error_table
from vehicle.model.tractor import Tractor
from vehicle.trials.drive import CONTROLLED_POINT_M, SLIP_LOOKAHEAD_M, Trace
from vehicle.trials.path_following import (
    FIRST_PASS,
    OMEGAS,
    PASS_M,
    SECOND_PASS,
    NavigationPasses,
    PathTracking,
    compute_distance_m,
    drive_navigation,
    drive_slip_test,
    drive_zigzag,
)
from vehicle.trials.sheets.fixed_steering import build_slip_panel
from vehicle.trials.sheets.sheet import (
    MUD_RATIO,
    TABLE_3_4,
    TABLE_4_3,
    TWIN_DIFFERENCES,
    ExperimentSheet,
    PlotLine,
    PlotPanel,
    TextTable,
    ThesisComparison,
    build_map_panel,
    build_time_panel,
)

LOOKAHEADS_M = (5.0, 3.0)
SIMULATORS = ("proposed", "traditional", "none")
NOT_PRINTED = "the thesis shows the zigzag in figures and prints no number"
POINTS_M = (0.0, -0.3, -0.6, -0.75)
LATERAL = ("lateral error, maximum", "lateral error, average")
HEADING = ("heading error, maximum", "heading error, average")


def build_zigzag_sheet(tractor: Tractor) -> ExperimentSheet:
    """Section 3.3: the thesis prints no numbers, so ours are shown with its statement."""
    drives = {
        (ahead, omega, name): drive_zigzag(tractor, omega, name, lookahead_m=ahead)
        for ahead in LOOKAHEADS_M
        for omega in OMEGAS
        for name in SIMULATORS
    }
    rows = []
    for ahead in LOOKAHEADS_M:
        for omega in OMEGAS:
            proposed, traditional = drives[ahead, omega, "proposed"], drives[ahead, omega, "traditional"]
            apart = [f"{100 * metres:.1f} cm" for metres in compute_distance_m(proposed, traditional)]
            laterals = [f"{drive.lateral_max_m:.2f} m" for drive in (proposed, traditional)]
            rows.append((f"{ahead:g} m", f"1/{round(1 / omega)}", *laterals, *apart))
    header = ("Lookahead", "omega (1/m)", "Lateral, proposed", "Lateral, traditional", "Apart, largest", "Apart, mean")
    words = (
        "P_y = A sin(omega P_x), A = 5 m, soil, 5 km/h (Eq. 3.1). The thesis finds that the two simulators differ more "
        "as omega grows.",
        *(_describe_zigzag(drives, ahead) for ahead in LOOKAHEADS_M),
    )
    panels = tuple(
        _build_zigzag_panel(drives, ahead, OMEGAS[-1], f"omega = 1/3, lookahead {ahead:g} m") for ahead in LOOKAHEADS_M
    )
    wheels = tuple(
        build_wheel_panel(f"Wheel angle, {name}, omega = 1/3, lookahead 3 m", drives[3.0, OMEGAS[-1], name].trace)
        for name in ("proposed", "traditional")
    )
    table = TextTable("Zigzag", header, tuple(rows))
    return ExperimentSheet("zigzag", "Zigzag (section 3.3)", words, _compare_zigzag(drives), panels + wheels, (table,))


def _compare_zigzag(drives: dict[tuple[float, float, str], PathTracking]) -> tuple[ThesisComparison, ...]:
    """All our numbers; the thesis prints none."""
    rows = []
    for ahead in LOOKAHEADS_M:
        for omega in OMEGAS:
            largest, mean = compute_distance_m(drives[ahead, omega, "proposed"], drives[ahead, omega, "traditional"])
            ours = {
                (f"lateral error, maximum, {name}", "m"): drives[ahead, omega, name].lateral_max_m
                for name in SIMULATORS
            }
            ours["proposed and traditional apart, largest", "cm"] = 100.0 * largest
            ours["proposed and traditional apart, mean", "cm"] = 100.0 * mean
            label = f"zigzag lookahead {ahead:g} m omega 1/{round(1 / omega)}"
            rows += [ThesisComparison(label, *quantity, None, value, NOT_PRINTED) for quantity, value in ours.items()]
    return tuple(rows)


def _describe_zigzag(drives: dict[tuple[float, float, str], PathTracking], ahead: float) -> str:
    """How far the simulators are apart with one lookahead, and whether the third stage matters."""
    gaps, slews = [], []
    for omega in OMEGAS:
        proposed, traditional = drives[ahead, omega, "proposed"], drives[ahead, omega, "traditional"]
        gaps.append(100.0 * compute_distance_m(proposed, traditional)[0])
        slews.append(bool((proposed.trace.get_column("stage") == SLEW).mean() > 0.01))
    gap_list = ", ".join(f"{gap:.1f}" for gap in gaps)
    where = [f"1/{round(1 / omega)}" for omega, slew in zip(OMEGAS, slews, strict=True) if slew]
    stage = f"The third stage matters at omega = {', '.join(where)}." if where else "The third stage is hardly entered."
    return f"With a lookahead of {ahead:g} m they are {gap_list} cm apart at omega = 1/5, 1/4, 1/3. {stage}"


def _build_zigzag_panel(
    drives: dict[tuple[float, float, str], PathTracking], ahead: float, omega: float, title: str
) -> PlotPanel:
    lines = []
    for number, name in enumerate(SIMULATORS):
        place = drives[ahead, omega, name].trace.compute_path()
        lines.append(PlotLine(name, place[:, 1], -place[:, 0], number))
    x = np.linspace(0.0, float(place[:, 1].max()), 600)
    lines.append(PlotLine("path", x, 5.0 * np.sin(omega * x), 3, True))
    return PlotPanel(title, "P_x (m)", "P_y (m)", tuple(lines), equal_axes=True)


def build_wheel_panel(title: str, trace: Trace, from_s: float = -math.inf, until_s: float = math.inf) -> PlotPanel:
    """Command and wheel angle over time, the wheel angle coloured by stage."""
    part = (trace.time_s > from_s) & (trace.time_s < until_s)
    time, stages = trace.time_s[part], trace.get_column("stage")[part]
    command, wheels = (np.degrees(trace.get_column(name))[part] for name in ("command", "steering"))
    lines = (PlotLine("command", time, command, 3, True), PlotLine("wheel angle", time, wheels, 0, False, stages))
    return build_time_panel(title, "Angle (degrees)", lines)


def build_navigation_sheet(tractor: Tractor, seed: int = 1) -> ExperimentSheet:
    """Table 3.4; the column of the digital twin is lost, the text only gives its difference from the real tractor."""
    passes = drive_navigation(tractor, position_errors=load_default_error_table(), seed=seed)
    lateral = passes.lateral_max_cm, passes.lateral_mean_cm
    ours = dict(zip(LATERAL + HEADING, (*lateral, passes.heading_max_deg, passes.heading_mean_deg), strict=True))
    rows = []
    for (number, quantity, unit), thesis in TABLE_3_4.items():
        note = "physical space, other field and start; the twin's column is lost"
        if (quantity, unit) in TWIN_DIFFERENCES:
            note += f", it differed by {TWIN_DIFFERENCES[quantity, unit][number - 1]:g} {unit}"
        rows.append(ThesisComparison(f"3.4 path {number}", quantity, unit, thesis, ours[quantity][number - 1], note))
    words = (
        f"Yard, U-turn, {PASS_M:g} m of soil, a switch-back in the headland and back; 5 km/h, 5 m lookahead, with GNSS "
        "errors. Lengths and turns are assumed, as the plan is only a figure. The largest errors occur at the entry to "
        "a pass.",
        "The thesis's longitudinal drift of 1 to 1.5 m in 120 s is against the real tractor, of which there is no log.",
    )
    panels = _build_navigation_panels(passes)
    return ExperimentSheet("navigation", "Real navigation plan (Table 3.4)", words, tuple(rows), panels)


def _build_navigation_panels(passes: NavigationPasses) -> tuple[PlotPanel, ...]:
    trace = passes.trace
    place, leg = trace.compute_path(), trace.get_column("leg")
    whole = PlotLine("controlled point", place[:, 0], place[:, 1], 0)
    plan = np.concatenate([part.points for part in passes.mission.legs])
    planned = PlotLine("plan", plan[:, 0], plan[:, 1], 3, True)
    head = place[:, 1] > PASS_M - 15.0
    turn = PlotLine("controlled point", place[head, 0], place[head, 1], 0)
    is_near = plan[:, 1] > PASS_M - 15.0
    errors = []
    for number, passing in enumerate((FIRST_PASS, SECOND_PASS)):
        rows = leg == passing
        x = passes.mission.legs[passing].points[0, 0]
        sign = 1.0 if number == 0 else -1.0
        driven = np.abs(place[rows, 1] - passes.mission.legs[passing].points[0, 1])
        errors.append(PlotLine(f"pass {number + 1}", driven, 100.0 * sign * (x - place[rows, 0]), number))
    near_plan = PlotLine("plan", plan[is_near, 0], plan[is_near, 1], 3, True)
    return (
        build_map_panel("The plan and the drive", (planned, whole)),
        build_map_panel("Switch-back", (near_plan, turn)),
        PlotPanel("Lateral error on soil", "Along the pass (m)", "Path lies to the right by (cm)", tuple(errors)),
    )


def build_slip_sheet(tractor: Tractor) -> ExperimentSheet:
    """Table 4.3 with one setting, compared with plain tyres and other controlled points."""
    pairs = [(ground, model) for ground in ("asphalt", "mud") for model in ("nonlinear", "linear")]
    results = {pair: drive_slip_test(tractor, *pair) for pair in pairs}
    plain = {pair: drive_slip_test(tractor, *pair, curve=None) for pair in pairs}
    rows = []
    for (ground, subject), printed in TABLE_4_3.items():
        pair = (ground, "nonlinear" if subject == "real" else subject)
        quantities, values = zip(LATERAL + HEADING, ("m", "m", "deg", "deg"), strict=True), (results[pair], plain[pair])
        columns = (printed, *map(_list_errors, values))
        for (quantity, unit), thesis, ours, bare in zip(quantities, *columns, strict=True):
            note = f"without the engine's curve {bare:.3g} {unit}"
            if subject == "real":
                note = "real tractor against our non-linear model; " + note
            rows.append(ThesisComparison(f"4.3 {ground} {subject}", quantity, unit, thesis, ours, note))
    ratio = results["mud", "nonlinear"].lateral_mean_m / results["mud", "linear"].lateral_mean_m
    words = (
        f"Waves of 5 m and 37.6 m at 5 km/h, lookahead {SLIP_LOOKAHEAD_M} m, controlled point {-CONTROLLED_POINT_M} m "
        "behind the centre of mass, with the engine's curve: one setting for all 16 numbers. Angles are not corrected.",
        f"In mud the mean lateral error of the non-linear model is {ratio:.2f} times that of the linear one (thesis "
        f"{MUD_RATIO:.2f}). Without the curve the models hardly differ.",
        "Heading errors are measured against the line to the target point (section 2.2.3).",
    )
    panels, tables = _build_slip_panels(results), (_build_point_table(tractor),)
    return ExperimentSheet("slip", "Asphalt and mud (Table 4.3)", words, tuple(rows), panels, tables)


def _list_errors(result: PathTracking) -> tuple[float, float, float, float]:
    return result.lateral_max_m, result.lateral_mean_m, result.heading_max_deg, result.heading_mean_deg


def _build_point_table(tractor: Tractor) -> TextTable:
    rows = []
    for point in POINTS_M:
        cells = []
        for ground, model in (("asphalt", "nonlinear"), ("mud", "nonlinear"), ("mud", "linear")):
            result = drive_slip_test(tractor, ground, model, point_m=point)
            lateral = f"{result.lateral_max_m:.3f} / {result.lateral_mean_m:.3f} m"
            cells.append(f"{lateral}, {result.heading_mean_deg:.2f} deg")
        rows.append((f"{point:+.2f} m", *cells))
    header = ("Controlled point ahead of the centre of mass", "Asphalt", "Mud, non-linear", "Mud, linear")
    return TextTable("Lateral error, maximum / average, and mean heading error", header, tuple(rows))


def _build_slip_panels(results: dict[tuple[str, str], PathTracking]) -> tuple[PlotPanel, ...]:
    panels = []
    for ground in ("asphalt", "mud"):
        lateral, heading, path_lines = [], [], []
        for number, model in enumerate(("nonlinear", "linear")):
            result = results[ground, model]
            time = result.trace.time_s
            lateral.append(PlotLine(model, time, 100.0 * result.errors.lateral_m, number))
            heading.append(PlotLine(model, time, np.degrees(result.errors.heading_rad), number))
            place = result.trace.compute_path()
            path_lines.append(PlotLine(model, place[:, 1], -place[:, 0], number))
        x = np.linspace(0.0, float(place[:, 1].max()), 600)
        path_lines.append(PlotLine("path", x, 5.0 * np.sin(math.pi / 18.8 * x), 3, True))
        panels.append(PlotPanel(f"Paths on {ground}", "P_x (m)", "P_y (m)", tuple(path_lines), equal_axes=True))
        panels.append(build_time_panel(f"Lateral error on {ground}", "Lateral error (cm)", lateral))
        panels.append(build_time_panel(f"Heading error on {ground}", "Heading error (degrees)", heading))
    for model in ("nonlinear", "linear"):
        trace = results["mud", model].trace
        panels.append(build_slip_panel(f"Slip in mud, {model}", trace, float(trace.time_s[-1])))
    return tuple(panels)
