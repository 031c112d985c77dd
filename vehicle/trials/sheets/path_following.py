"""Sheets of paths: steps (section 3.2, Tables 3.1 to 3.3), zigzag (3.3), navigation (Table 3.4), mud (Table 4.3)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from fields.arrays import Integers
from vehicle.model.gnss import NO_ERROR, load_default_error_table
from vehicle.model.tractor import Tractor
from vehicle.trials.drive import CONTROLLED_POINT_M, LOOKAHEAD_M, SLIP_LOOKAHEAD_M, UNLIMITED_M, Trace
from vehicle.trials.path_following import (
    AMPLITUDE_M,
    FIRST_PASS,
    FIRST_PATH_M,
    HALF_PERIOD_M,
    OFFSETS_CM,
    OMEGAS,
    PASS_M,
    SECOND_PASS,
    SECOND_PATH_M,
    SPEEDS_KMH,
    PathTracking,
    StepResponse,
    drive_navigation,
    drive_slip_test,
    drive_step_response,
    drive_zigzag,
    find_slewing,
    measure_gap_m,
    measure_weaving_m,
)
from vehicle.trials.sheets.fixed_steering import build_slip_panel
from vehicle.trials.sheets.sheet import (
    MUD_RATIO,
    TABLE_3_1,
    TABLE_3_2,
    TABLE_3_3,
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

LOOKAHEADS_M = (LOOKAHEAD_M, 3.0)
SIMULATORS = ("proposed", "traditional", "none")
NOT_PRINTED = "the thesis shows the zigzag in figures and prints no number"
POINTS_M = (0.0, -0.3, -0.6, -0.75)
LATERAL = ("lateral error, maximum", "lateral error, average")
HEADING = ("heading error, maximum", "heading error, average")
AGREEMENT_CM = 8.0
LENGTHS_M = (24.0, SECOND_PATH_M, 32.0, 40.0)
GROUNDS = ("asphalt", "soil")
Steps = dict[tuple[str, str, float, int], StepResponse]
NO_LOG = "needs a log of the real tractor, and none exists"


def build_zigzag_sheet(tractor: Tractor) -> ExperimentSheet:
    """Section 3.3: the thesis prints no numbers, so ours are shown with its statement."""
    drives = {
        (ahead, omega, name): drive_zigzag(tractor, omega, name, lookahead_m=ahead)
        for ahead in LOOKAHEADS_M
        for omega in OMEGAS
        for name in SIMULATORS
    }
    apart = {
        setting: measure_gap_m(*(drives[*setting, name].trace.compute_path() for name in SIMULATORS[:2]))
        for setting in itertools.product(LOOKAHEADS_M, OMEGAS)
    }
    rows, comparisons = [], []
    for (ahead, omega), (largest, mean) in apart.items():
        laterals = {name: drives[ahead, omega, name].sizes.lateral_max for name in SIMULATORS}
        cells = [f"{laterals[name]:.2f} m" for name in SIMULATORS[:2]]
        cells += [f"{100 * metres:.1f} cm" for metres in (largest, mean)]
        rows.append((f"{ahead:g} m", f"1/{round(1 / omega)}", *cells))
        # All our numbers; the thesis prints none.
        ours = {(f"lateral error, maximum, {name}", "m"): metres for name, metres in laterals.items()}
        ours["proposed and traditional apart, largest", "cm"] = 100.0 * largest
        ours["proposed and traditional apart, mean", "cm"] = 100.0 * mean
        label = f"zigzag lookahead {ahead:g} m omega 1/{round(1 / omega)}"
        comparisons += [ThesisComparison(label, *what, None, value, NOT_PRINTED) for what, value in ours.items()]
    header = ("Lookahead", "omega (1/m)", "Lateral, proposed", "Lateral, traditional", "Apart, largest", "Apart, mean")
    words = (
        "P_y = A sin(omega P_x), A = 5 m, soil, 5 km/h (Eq. 3.1). The thesis finds that the two simulators differ more "
        "as omega grows.",
        *(_describe_zigzag(drives, apart, ahead) for ahead in LOOKAHEADS_M),
    )
    panels = tuple(
        _build_wave_panel(
            f"omega = 1/3, lookahead {ahead:g} m",
            {name: drives[ahead, OMEGAS[-1], name] for name in SIMULATORS},
            OMEGAS[-1],
        )
        for ahead in LOOKAHEADS_M
    )
    wheels = tuple(
        build_wheel_panel(f"Wheel angle, {name}, omega = 1/3, lookahead 3 m", drives[3.0, OMEGAS[-1], name].trace)
        for name in ("proposed", "traditional")
    )
    table = TextTable("Zigzag", header, tuple(rows))
    title, pictures = "Zigzag (section 3.3)", panels + wheels
    return ExperimentSheet("zigzag", title, words, tuple(comparisons), pictures, (table,))


def _describe_zigzag(
    drives: dict[tuple[float, float, str], PathTracking], apart: dict[tuple[float, float], tuple[float, float]],
    ahead: float,
) -> str:  # fmt: skip
    """How far the simulators are apart with one lookahead, and whether the third stage matters."""
    gap_list = ", ".join(f"{100.0 * apart[ahead, omega][0]:.1f}" for omega in OMEGAS)
    slews = [omega for omega in OMEGAS if find_slewing(drives[ahead, omega, "proposed"].trace).mean() > 0.01]
    where = [f"1/{round(1 / omega)}" for omega in slews]
    stage = f"The third stage matters at omega = {', '.join(where)}." if where else "The third stage is hardly entered."
    return f"With a lookahead of {ahead:g} m they are {gap_list} cm apart at omega = 1/5, 1/4, 1/3. {stage}"


def _build_wave_panel(title: str, drives: dict[str, PathTracking], omega: float) -> PlotPanel:
    """Driven paths by name beside the wave; the last one is as long as the wave is drawn."""
    lines = []
    for number, (name, drive) in enumerate(drives.items()):
        place = drive.trace.compute_path()
        lines.append(PlotLine(name, place[:, 1], -place[:, 0], number))
    x = np.linspace(0.0, float(place[:, 1].max()), 600)
    lines.append(PlotLine("path", x, AMPLITUDE_M * np.sin(omega * x), 3, True))
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
    ours = dict(zip(LATERAL + HEADING, zip(*passes.sizes, strict=True), strict=True))
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
    place, plan = passes.trace.compute_path(), np.concatenate([part.points for part in passes.mission.legs])
    head, is_near = place[:, 1] > PASS_M - 15.0, plan[:, 1] > PASS_M - 15.0
    whole, turn = (PlotLine("controlled point", part[:, 0], part[:, 1], 0) for part in (place, place[head]))
    planned, near_plan = (PlotLine("plan", part[:, 0], part[:, 1], 3, True) for part in (plan, plan[is_near]))
    errors = []
    for number, (passing, sign) in enumerate(((FIRST_PASS, 1.0), (SECOND_PASS, -1.0))):
        x, y = passes.mission.legs[passing].points[0]
        east, north = place[passes.trace.get_column("leg") == passing].T
        errors.append(PlotLine(f"pass {number + 1}", np.abs(north - y), 100.0 * sign * (x - east), number))
    panels = (
        build_map_panel("The plan and the drive", (planned, whole)),
        build_map_panel("Switch-back", (near_plan, turn)),
        PlotPanel("Lateral error on soil", "Along the pass (m)", "Path lies to the right by (cm)", tuple(errors)),
    )
    return ExperimentSheet("navigation", "Real navigation plan (Table 3.4)", words, tuple(rows), panels)


def build_slip_sheet(tractor: Tractor) -> ExperimentSheet:
    """Table 4.3 with one setting, compared with plain tyres and other controlled points."""
    pairs = [(ground, model) for ground in ("asphalt", "mud") for model in ("nonlinear", "linear")]
    results = {pair: drive_slip_test(tractor, *pair) for pair in pairs}
    plain = {pair: drive_slip_test(tractor, *pair, curve=None) for pair in pairs}
    rows = []
    for (ground, subject), printed in TABLE_4_3.items():
        pair = (ground, "nonlinear" if subject == "real" else subject)
        quantities = zip(LATERAL + HEADING, ("m", "m", "deg", "deg"), strict=True)
        columns = printed, results[pair].sizes, plain[pair].sizes
        for (quantity, unit), thesis, ours, bare in zip(quantities, *columns, strict=True):
            note = f"without the engine's curve {bare:.3g} {unit}"
            if subject == "real":
                note = "real tractor against our non-linear model; " + note
            rows.append(ThesisComparison(f"4.3 {ground} {subject}", quantity, unit, thesis, ours, note))
    ratio = results["mud", "nonlinear"].sizes.lateral_mean / results["mud", "linear"].sizes.lateral_mean
    words = (
        f"Waves of 5 m and 37.6 m at 5 km/h, lookahead {SLIP_LOOKAHEAD_M} m, controlled point {-CONTROLLED_POINT_M} m "
        "behind the centre of mass, with the engine's curve: one setting for all 16 numbers. Angles are not corrected.",
        f"In mud the mean lateral error of the non-linear model is {ratio:.2f} times that of the linear one (thesis "
        f"{MUD_RATIO:.2f}). Without the curve the models hardly differ.",
        "Heading errors are measured against the line to the target point (section 2.2.3).",
    )
    points = []
    for point in POINTS_M:
        cells = []
        for ground, model in (("asphalt", "nonlinear"), ("mud", "nonlinear"), ("mud", "linear")):
            sizes = drive_slip_test(tractor, ground, model, point_m=point).sizes
            lateral = f"{sizes.lateral_max:.3f} / {sizes.lateral_mean:.3f} m"
            cells.append(f"{lateral}, {sizes.heading_mean_deg:.2f} deg")
        points.append((f"{point:+.2f} m", *cells))
    header = ("Controlled point ahead of the centre of mass", "Asphalt", "Mud, non-linear", "Mud, linear")
    table = TextTable("Lateral error, maximum / average, and mean heading error", header, tuple(points))
    panels = _build_slip_panels(results)
    return ExperimentSheet("slip", "Asphalt and mud (Table 4.3)", words, tuple(rows), panels, (table,))


def _build_slip_panels(results: dict[tuple[str, str], PathTracking]) -> tuple[PlotPanel, ...]:
    panels = []
    for ground in ("asphalt", "mud"):
        lateral, heading = [], []
        for number, model in enumerate(("nonlinear", "linear")):
            result = results[ground, model]
            time = result.trace.time_s
            lateral.append(PlotLine(model, time, 100.0 * result.errors.lateral_m, number))
            heading.append(PlotLine(model, time, np.degrees(result.errors.heading_rad), number))
        drives = {model: results[ground, model] for model in ("nonlinear", "linear")}
        panels.append(_build_wave_panel(f"Paths on {ground}", drives, math.pi / HALF_PERIOD_M))
        panels.append(build_time_panel(f"Lateral error on {ground}", "Lateral error (cm)", lateral))
        panels.append(build_time_panel(f"Heading error on {ground}", "Heading error (degrees)", heading))
    for model in ("nonlinear", "linear"):
        trace = results["mud", model].trace
        panels.append(build_slip_panel(f"Slip in mud, {model}", trace, float(trace.time_s[-1])))
    return tuple(panels)


def build_step_sheet(tractor: Tractor, seed: int = 1) -> ExperimentSheet:
    """Tables 3.1, 3.2 and 3.3, and the plots of Fig. 3.2 to 3.5."""
    quiet = _drive_steps(tractor, UNLIMITED_M, seed, SIMULATORS, grounds=GROUNDS, errors=NO_ERROR)
    noisy = _drive_steps(tractor, tractor.guidance.lateral_limit_m, seed)
    bare = _drive_steps(tractor, UNLIMITED_M, seed)
    rows = _compare_trajectories(quiet) + _compare_table_3_3(noisy, bare)
    words = _describe_results(quiet, noisy, bare, tractor.guidance.lateral_limit_m)
    tables = (_build_path_length_table(tractor, noisy, seed), _build_weaving_table(tractor))
    title, panels = "Step response (Tables 3.1 to 3.3)", _build_panels(quiet)
    return ExperimentSheet("step", title, words, tuple(rows), panels, tables)


def _drive_steps(
    tractor: Tractor,
    limit_m: float,
    seed: int,
    simulators: Sequence[str] = ("proposed", "traditional"),
    second_m: float = SECOND_PATH_M,
    *,
    grounds: Sequence[str] = ("soil",),
    errors: Integers | None = None,
) -> Steps:
    """Drives by ground, simulator, speed and offset, each with its own GNSS errors: on soil those of Table 3.3."""
    table = load_default_error_table() if errors is None else errors
    return {
        (ground, steering, speed, offset): drive_step_response(
            tractor, offset, speed, ground, steering,
            position_errors=table, seed=1000 * seed + number, limit_m=limit_m, second_m=second_m,
        )
        for ground in grounds
        for steering in simulators
        for speed in SPEEDS_KMH
        for number, offset in enumerate(OFFSETS_CM)
    }  # fmt: skip


def _build_path_length_table(tractor: Tractor, noisy: Steps, seed: int) -> TextTable:
    """Table 3.3 with other lengths of path 2: the remaining swing in the last 15 m outweighs the GNSS errors."""
    rows = []
    for length in LENGTHS_M:
        drives = noisy
        if length != SECOND_PATH_M:
            drives = _drive_steps(tractor, tractor.guidance.lateral_limit_m, seed, ("proposed",), length)
        cells = [drive.mean_lateral_error_cm for key, drive in drives.items() if key[1] == "proposed"]
        inside = sum(2.0 <= cell <= 6.0 for cell in cells)
        rows.append((f"{length:g} m", f"{inside} of {len(cells)}", f"{min(cells):.1f} cm", f"{max(cells):.1f} cm"))
    title = "Table 3.3, proposed simulator, by the assumed length of path 2"
    return TextTable(title, ("Path 2", "Between 2 and 6 cm", "Smallest", "Largest"), tuple(rows))


def _compare_trajectories(steps: Steps) -> list[ThesisComparison]:
    """Tables 3.1 and 3.2: of the real tractor there is no log, so the notes compare our simulators."""
    bare = "our path differs by {:.1f} cm from one without simulator"
    apart = "our proposed and traditional simulators are {:.1f} cm apart"
    tables = [(f"3.1 {key[0]} km/h", *key, "asphalt", "none", bare, values) for key, values in TABLE_3_1.items()]
    tables += [
        (f"3.2 {key[0]} {key[1]} km/h", *key[1:], "soil", "traditional", apart, values)
        for key, values in TABLE_3_2.items()
    ]
    rows = []
    for name, speed, kind, ground, other, words, values in tables:
        for offset, thesis in zip(OFFSETS_CM, values, strict=True):
            proposed, compared = (steps[ground, steering, speed, offset] for steering in ("proposed", other))
            note = f"{NO_LOG}; {words.format(proposed.compute_difference_cm(compared)[kind == 'average'])}"
            label = f"{name} {offset:+d} cm"
            rows.append(ThesisComparison(label, f"trajectory difference, {kind}", "cm", thesis, None, note))
    return rows


def _compare_table_3_3(noisy: Steps, bare: Steps) -> list[ThesisComparison]:
    rows = []
    for (subject, speed), values in TABLE_3_3.items():
        steering = "traditional" if subject == "traditional" else "proposed"
        for offset, thesis in zip(OFFSETS_CM, values, strict=True):
            ours = noisy["soil", steering, float(speed), offset].mean_lateral_error_cm
            plain = bare["soil", steering, float(speed), offset].mean_lateral_error_cm
            note = f"lateral error limited to 0.7 m; with the plain Eq. 2.5 {plain:.1f} cm"
            if subject == "physical space":
                note = "real tractor against our proposed simulator; " + note
            name = f"3.3 {subject} {speed} km/h {offset:+d} cm"
            rows.append(ThesisComparison(name, "lateral error, average of last 15 m", "cm", thesis, ours, note))
    return rows


def _compute_gap_range(steps: Steps, size: int) -> tuple[float, float]:
    """Smallest and largest gap (cm) between the simulators on soil over the drives with an offset of this size."""
    gaps = []
    for speed, offset in itertools.product(SPEEDS_KMH, (-size, size)):
        traditional = steps["soil", "traditional", speed, offset]
        gaps.append(steps["soil", "proposed", speed, offset].compute_difference_cm(traditional)[0])
    return min(gaps), max(gaps)


def _build_weaving_table(tractor: Tractor) -> TextTable:
    """The plain and the limited Eq. 2.5 when the full offset applies at once."""
    limit = tractor.guidance.lateral_limit_m
    rows = []
    for offset in (50, 100, 150, 200):
        weaving = [measure_weaving_m(tractor, offset, limit_m=most) for most in (UNLIMITED_M, limit)]
        rows.append((f"{offset} cm", *(f"{metres:.2f} m" for metres in weaving)))
    title = "Started beside a straight path at 5 km/h on soil: largest lateral error in the third minute"
    header = ("Offset at the start", "Plain Eq. 2.5", f"Lateral error limited to {limit:g} m")
    return TextTable(title, header, tuple(rows))


def _describe_results(quiet: Steps, noisy: Steps, bare: Steps, limit_m: float) -> tuple[str, ...]:
    limited_cm = [drive.mean_lateral_error_cm for key, drive in noisy.items() if key[1] == "proposed"]
    inside = sum(2.0 <= value <= 6.0 for value in limited_cm)
    plain = [drive.mean_lateral_error_cm for key, drive in bare.items() if key[1] == "proposed"]
    ranges = {size: _compute_gap_range(quiet, size) for size in (50, 100, 150, 200)}
    gaps = "; ".join(f"{size} cm: {low:.1f} to {high:.1f} cm" for size, (low, high) in ranges.items())
    finding = "The thesis's finding that the simulators agree at 50 cm and differ from 100 cm on is not confirmed."
    if ranges[50][1] < AGREEMENT_CM < ranges[100][0]:
        within = f"within {AGREEMENT_CM:g} cm"
        finding = f"Proposed and traditional simulators agree at 50 cm ({within}) and differ from 100 cm on."
    small = [drive for key, drive in quiet.items() if key[1] == "proposed" and abs(key[3]) == 50]
    slewing = sum(drive.enters_third_stage for drive in small)
    return (
        f"Path 1 of {FIRST_PATH_M:g} m, path 2 of {SECOND_PATH_M:g} m (the length is not printed and decides how much "
        "swing remains in the last 15 m), lookahead 5 m, controlled point 0.6 m behind the centre of mass.",
        f"Table 3.3: {inside} of {len(limited_cm)} cells are between 2 and 6 cm with the lateral error of Eq. 2.5 "
        f"limited to {limit_m:g} m ({min(limited_cm):.1f} to {max(limited_cm):.1f} cm), and "
        f"{sum(2.0 <= v <= 6.0 for v in plain)} with the plain law: from 2 m at 5 km/h the locked third stage may "
        f"carry the tractor past path 2 ({max(plain):.1f} cm).",
        f"{finding} Largest distance between the two on soil: {gaps}.",
        f"The thesis supposes that the third stage is not entered at 50 cm; here it is entered in {slewing} of "
        f"{len(small)} drives of 50 cm.",
    )


def _build_panels(steps: Steps) -> tuple[PlotPanel, ...]:
    groups = {
        f"Paths on {ground}, 5 km/h": {
            f"{offset:+d} cm": steps[ground, "proposed", 5.0, offset] for offset in (-200, -100, -50, 50, 100, 200)
        }
        for ground in GROUNDS
    }
    for offset in (50, 100, 200):
        simulators = {name: steps["soil", name, 5.0, offset] for name in SIMULATORS}
        groups[f"{offset} cm on soil, 5 km/h: three simulators"] = simulators
    panels = []
    for title, drives in groups.items():
        paths = {label: drive.trace.compute_path() for label, drive in drives.items()}
        lines = [PlotLine(label, xy[:, 1], 100 * xy[:, 0], number) for number, (label, xy) in enumerate(paths.items())]
        panels.append(PlotPanel(title, "Along the path (m)", "To the right (cm)", tuple(lines)))
    for name in ("proposed", "traditional"):
        trace = steps["soil", name, 5.0, 200].trace
        panels.append(build_wheel_panel(f"Wheel angle, {name}, 200 cm on soil, 5 km/h", trace, 9.0, 26.0))
    return tuple(panels)
