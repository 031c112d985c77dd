"""Experiments along paths: zigzag (3.3), real navigation (Table 3.4), asphalt and mud (Table 4.3)."""

from __future__ import annotations

import math

import numpy as np

from vehicle.gnss import default_table
from vehicle.steering import SLEW
from vehicle.tractor import Tractor
from vehicle.trials.navigation import FIRST_PASS, PASS_M, SECOND_PASS, Passes, navigation
from vehicle.trials.setting import CONTROLLED_M, SLIP_LOOKAHEAD_M
from vehicle.trials.sheets.circles import slip_panel
from vehicle.trials.sheets.sheet import Comparison, Line, Panel, Sheet, TextTable
from vehicle.trials.thesis import MUD_RATIO, TABLE_3_4, TABLE_4_3, TWIN_APART
from vehicle.trials.waves import OMEGAS, Tracking, apart_m, slip_test, zigzag

LOOKAHEADS_M = (5.0, 3.0)
SIMULATORS = ("proposed", "traditional", "none")
NOT_PRINTED = "the thesis shows the zigzag in figures and prints no number"
POINTS_M = (0.0, -0.3, -0.6, -0.75)
LATERAL = ("lateral error, maximum", "lateral error, average")
HEADING = ("heading error, maximum", "heading error, average")


def zigzag_sheet(tractor: Tractor) -> Sheet:
    """Section 3.3: the thesis prints no numbers, so ours are shown with the statement they bear on."""
    drives = {
        (ahead, omega, name): zigzag(tractor, omega, name, lookahead_m=ahead)
        for ahead in LOOKAHEADS_M
        for omega in OMEGAS
        for name in SIMULATORS
    }
    rows = []
    for ahead in LOOKAHEADS_M:
        for omega in OMEGAS:
            one, other = drives[ahead, omega, "proposed"], drives[ahead, omega, "traditional"]
            largest, mean = apart_m(one, other)
            rows.append((
                f"{ahead:g} m", f"1/{round(1 / omega)}", f"{one.lateral_max_m:.2f} m", f"{other.lateral_max_m:.2f} m",
                f"{100 * largest:.1f} cm", f"{100 * mean:.1f} cm",
            ))  # fmt: skip
    header = ("Lookahead", "omega (1/m)", "Lateral, proposed", "Lateral, traditional", "Apart, largest", "Apart, mean")
    words = (
        "P_y = A sin(omega P_x), A = 5 m, soil, 5 km/h (Eq. 3.1). The thesis finds the two simulators ever farther "
        "apart as omega grows.",
        *(_zigzag_words(drives, ahead) for ahead in LOOKAHEADS_M),
    )
    panels = tuple(
        _zigzag_panel(drives, ahead, OMEGAS[-1], f"omega = 1/3, lookahead {ahead:g} m") for ahead in LOOKAHEADS_M
    )
    wheels = tuple(
        wheel_panel(f"Wheel angle, {name}, omega = 1/3, lookahead 3 m", drives[3.0, OMEGAS[-1], name])
        for name in ("proposed", "traditional")
    )
    table = TextTable("Zigzag", header, tuple(rows))
    return Sheet("zigzag", "Zigzag (section 3.3)", words, _zigzag_numbers(drives), panels + wheels, (table,))


def _zigzag_numbers(drives: dict[tuple[float, float, str], Tracking]) -> tuple[Comparison, ...]:
    """Every number of ours; none has a printed one beside it."""
    rows = []
    for ahead in LOOKAHEADS_M:
        for omega in OMEGAS:
            largest, mean = apart_m(drives[ahead, omega, "proposed"], drives[ahead, omega, "traditional"])
            ours = {(f"lateral error, maximum, {name}", "m"): drives[ahead, omega, name].lateral_max_m
                    for name in SIMULATORS}  # fmt: skip
            ours["proposed and traditional apart, largest", "cm"] = 100.0 * largest
            ours["proposed and traditional apart, mean", "cm"] = 100.0 * mean
            label = f"zigzag lookahead {ahead:g} m omega 1/{round(1 / omega)}"
            rows += [Comparison(label, *quantity, None, value, NOT_PRINTED) for quantity, value in ours.items()]
    return tuple(rows)


def _zigzag_words(drives: dict[tuple[float, float, str], Tracking], ahead: float) -> str:
    """How far the simulators are apart with one lookahead, and whether the third stage has a part in it."""
    gaps, slews = [], []
    for omega in OMEGAS:
        one, other = drives[ahead, omega, "proposed"], drives[ahead, omega, "traditional"]
        gaps.append(100.0 * apart_m(one, other)[0])
        slews.append(bool((one.track.column("stage") == SLEW).mean() > 0.01))
    shown = ", ".join(f"{gap:.1f}" for gap in gaps)
    where = [f"1/{round(1 / omega)}" for omega, slew in zip(OMEGAS, slews, strict=True) if slew]
    stage = f"The third stage matters at omega = {', '.join(where)}." if where else "The third stage is hardly entered."
    return f"With a lookahead of {ahead:g} m they are {shown} cm apart at omega = 1/5, 1/4, 1/3. {stage}"


def _zigzag_panel(drives: dict[tuple[float, float, str], Tracking], ahead: float, omega: float, title: str) -> Panel:
    lines = []
    for number, name in enumerate(SIMULATORS):
        place = drives[ahead, omega, name].track.place()
        lines.append(Line(name, place[:, 1], -place[:, 0], number))
    x = np.linspace(0.0, float(place[:, 1].max()), 600)
    lines.append(Line("path", x, 5.0 * np.sin(omega * x), 3, True))
    return Panel(title, "P_x (m)", "P_y (m)", tuple(lines), equal=True)


def wheel_panel(title: str, drive: Tracking) -> Panel:
    """Command and wheel angle, the wheel angle in the colours of the stages."""
    track = drive.track
    command, wheels = (np.degrees(track.column(name)) for name in ("command", "steering"))
    lines = (
        Line("command", track.time_s, command, 3, True),
        Line("wheel angle", track.time_s, wheels, 0, False, track.column("stage")),
    )
    return Panel(title, "Time (s)", "Angle (degrees)", lines)


def navigation_sheet(tractor: Tractor, seed: int = 1) -> Sheet:
    """Table 3.4; the column of the digital twin is lost, only its distance from the real tractor is in the text."""
    found = navigation(tractor, position_errors=default_table(), seed=seed)
    ours = {LATERAL[0]: found.lateral_max_cm, LATERAL[1]: found.lateral_mean_cm,
            HEADING[0]: found.heading_max_deg, HEADING[1]: found.heading_mean_deg}  # fmt: skip
    rows = []
    for (number, quantity, unit), thesis in TABLE_3_4.items():
        note = "physical space, other field and start; the twin's column is lost"
        if (quantity, unit) in TWIN_APART:
            note += f", it lay {TWIN_APART[quantity, unit][number - 1]:g} {unit} from this"
        rows.append(Comparison(f"3.4 path {number}", quantity, unit, thesis, ours[quantity][number - 1], note))
    words = (
        f"Yard, U-turn, {PASS_M:g} m of soil, a switch-back in the headland and back; 5 km/h, 5 m lookahead, GNSS "
        "error on. Lengths and turns are assumed: the plan is a figure only. Largest errors are those of entering a "
        "pass.",
        "The thesis's longitudinal drift of 1 to 1.5 m in 120 s is against the real tractor: no log, no number here.",
    )
    return Sheet("navigation", "Real navigation plan (Table 3.4)", words, tuple(rows), _navigation_panels(found))


def _navigation_panels(found: Passes) -> tuple[Panel, ...]:
    track = found.track
    place, leg = track.place(), track.column("leg")
    whole = Line("controlled point", place[:, 0], place[:, 1], 0)
    plan = np.concatenate([part.points for part in found.mission.legs])
    planned = Line("plan", plan[:, 0], plan[:, 1], 3, True)
    head = place[:, 1] > PASS_M - 15.0
    turn = Line("controlled point", place[head, 0], place[head, 1], 0)
    near = plan[:, 1] > PASS_M - 15.0
    errors = []
    for number, passing in enumerate((FIRST_PASS, SECOND_PASS)):
        rows = leg == passing
        x = found.mission.legs[passing].points[0, 0]
        sign = 1.0 if number == 0 else -1.0
        driven = np.abs(place[rows, 1] - found.mission.legs[passing].points[0, 1])
        errors.append(Line(f"pass {number + 1}", driven, 100.0 * sign * (x - place[rows, 0]), number))
    return (
        Panel("The plan and the drive", "East (m)", "North (m)", (planned, whole), equal=True),
        Panel("Switch-back", "East (m)", "North (m)",
              (Line("plan", plan[near, 0], plan[near, 1], 3, True), turn), equal=True),
        Panel("Lateral error on soil", "Along the pass (m)", "Path lies to the right by (cm)", tuple(errors)),
    )  # fmt: skip


def slip(tractor: Tractor) -> Sheet:
    """Table 4.3 with one setting, beside plain tyres and other controlled points."""
    pairs = [(ground, model) for ground in ("asphalt", "mud") for model in ("nonlinear", "linear")]
    found = {pair: slip_test(tractor, *pair) for pair in pairs}
    plain = {pair: slip_test(tractor, *pair, curve=None) for pair in pairs}
    rows = []
    for (ground, who), printed in TABLE_4_3.items():
        pair = (ground, "nonlinear" if who == "real" else who)
        values = zip(LATERAL + HEADING, ("m", "m", "deg", "deg"), printed, _four(found[pair]), _four(plain[pair]),
                     strict=True)  # fmt: skip
        for quantity, unit, thesis, ours, bare in values:
            note = f"without the engine's curve {bare:.3g} {unit}"
            if who == "real":
                note = "the real tractor beside our non-linear model; " + note
            rows.append(Comparison(f"4.3 {ground} {who}", quantity, unit, thesis, ours, note))
    ratio = found["mud", "nonlinear"].lateral_mean_m / found["mud", "linear"].lateral_mean_m
    words = (
        f"Waves of 5 m and 37.6 m at 5 km/h, lookahead {SLIP_LOOKAHEAD_M} m, the controlled point {-CONTROLLED_M} m "
        "behind the centre of mass, the engine's curve on: one setting for all 16 numbers. Angles uncorrected.",
        f"In mud the mean lateral error of the non-linear model is {ratio:.2f} times that of the linear one (thesis "
        f"{MUD_RATIO:.2f}). Without the curve the models hardly differ.",
        "Heading errors are against the line to the target point (section 2.2.3).",
    )
    return Sheet("slip", "Asphalt and mud (Table 4.3)", words, tuple(rows), _slip_panels(found),
                 (_point_table(tractor),))  # fmt: skip


def _four(result: Tracking) -> tuple[float, float, float, float]:
    return result.lateral_max_m, result.lateral_mean_m, result.heading_max_deg, result.heading_mean_deg


def _point_table(tractor: Tractor) -> TextTable:
    rows = []
    for point in POINTS_M:
        cells = []
        for ground, model in (("asphalt", "nonlinear"), ("mud", "nonlinear"), ("mud", "linear")):
            result = slip_test(tractor, ground, model, point_m=point)
            lateral = f"{result.lateral_max_m:.3f} / {result.lateral_mean_m:.3f} m"
            cells.append(f"{lateral}, {result.heading_mean_deg:.2f} deg")
        rows.append((f"{point:+.2f} m", *cells))
    header = ("Controlled point ahead of the centre of mass", "Asphalt", "Mud, non-linear", "Mud, linear")
    return TextTable("Lateral error, maximum / average, and mean heading error", header, tuple(rows))


def _slip_panels(found: dict[tuple[str, str], Tracking]) -> tuple[Panel, ...]:
    panels = []
    for ground in ("asphalt", "mud"):
        lateral, heading, tracks = [], [], []
        for number, model in enumerate(("nonlinear", "linear")):
            result = found[ground, model]
            time = result.track.time_s
            lateral.append(Line(model, time, 100.0 * result.errors.lateral, number))
            heading.append(Line(model, time, np.degrees(result.errors.heading), number))
            place = result.track.place()
            tracks.append(Line(model, place[:, 1], -place[:, 0], number))
        x = np.linspace(0.0, float(place[:, 1].max()), 600)
        tracks.append(Line("path", x, 5.0 * np.sin(math.pi / 18.8 * x), 3, True))
        panels.append(Panel(f"Tracks on {ground}", "P_x (m)", "P_y (m)", tuple(tracks), equal=True))
        panels.append(Panel(f"Lateral error on {ground}", "Time (s)", "Lateral error (cm)", tuple(lateral)))
        panels.append(Panel(f"Heading error on {ground}", "Time (s)", "Heading error (degrees)", tuple(heading)))
    for model in ("nonlinear", "linear"):
        track = found["mud", model].track
        panels.append(slip_panel(f"Slip in mud, {model}", track, float(track.time_s[-1])))
    return tuple(panels)
