"""Fixed and changing steering: circles of Eq. 2.9, 2.10 and 5.1, Table 4.1 and section 4.3.2."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vehicle.calibration import drive_circle
from vehicle.ground import tyres_on
from vehicle.tractor import Tractor, load_tractor
from vehicle.trials.drive import Trace
from vehicle.trials.fixed import (
    ANGLES_DEG,
    BEST_GUESS,
    MEASURED_AHEAD_M,
    Fixed,
    Guess,
    changing_steering,
    closest_table,
    fixed_steering,
    guesses,
    table_4_1,
)
from vehicle.trials.sheets.sheet import Comparison, Line, Panel, Sheet, TextTable
from vehicle.trials.thesis import TABLE_4_1

CIRCLES = (("2.9", "eg105", "asphalt"), ("2.10", "eg105", "soil"), ("5.1", "mr1000a", "soil"))
CIRCLE_ANGLES_DEG = (5, 10, 15, 20, 25, 30, 35)
SHOWN_S = 30.0


def circles(tractor: Tractor) -> Sheet:
    """Turning radii of the corrected base model beside the power laws measured in physical space."""
    rows, lines = [], []
    for number, (equation, name, ground) in enumerate(CIRCLES):
        machine = tractor if name == "eg105" else load_tractor(name)
        found = {
            sign * angle: drive_circle(machine, sign * angle, ground, seconds=30.0).radius_m
            for sign in (1, -1)
            for angle in CIRCLE_ANGLES_DEG
        }
        for angle, radius in found.items():
            law = machine.power_law(ground).radius_m(angle)
            side = "right" if angle > 0 else "left"
            rows.append(Comparison(
                f"Eq. {equation} {ground} {side} {abs(angle)} deg", "turning radius", "m", law, radius,
                "the measured radius 118.4 / (c |delta|^p), to which the model is calibrated",
            ))  # fmt: skip
        for sign, dashed in ((1, False), (-1, True)):
            radii = np.array([found[sign * angle] for angle in CIRCLE_ANGLES_DEG])
            side = "right" if sign > 0 else "left"
            lines.append(Line(f"Eq. {equation}, {machine.name} on {ground}, {side}",
                              np.array(CIRCLE_ANGLES_DEG, dtype=float), radii, number, dashed))  # fmt: skip
    worst = max(abs(row.difference_pct or 0.0) for row in rows)
    words = (
        "The corrected base model is calibrated to the measured radii, so this checks the calibration alone; the "
        f"largest difference is {worst:.2f} %.",
    )
    panel = Panel("Turning radius", "Steering angle (degrees)", "Radius (m)", tuple(lines))
    return Sheet("circles", "Circles at fixed steering (Eq. 2.9, 2.10, 5.1)", words, tuple(rows), (panel,))


def fixed(tractor: Tractor) -> Sheet:
    """Table 4.1, the pictures of Fig. 4.5 and 4.6, and the hypotheses about its non-linear column."""
    drives = table_4_1(tractor)
    plain = table_4_1(tractor, curve=None)
    tried = guesses(tractor)
    closest = closest_table(tractor)
    used = tyres_on("soil", "linear")
    free = fixed_steering(tractor, used.model_copy(update={"grip": None}))
    rows = [_radius_row(*trio) for trio in zip(drives, plain, closest, strict=True)]
    words = (
        "Tyres of section 4.3: front 0.005 and rear 0.01 of the load per degree, the non-linear ones up to 5 degrees; "
        "steering stepped at 5 km/h; angles go to the wheels uncorrected.",
        f"Radii are those of a point {MEASURED_AHEAD_M} m ahead of the centre of mass, which the kinematic column asks "
        "for; at the centre of mass the kinematic radii would be "
        + ", ".join(f"{drive.track.radius(0.0)[-1]:.2f}" for drive in drives[:3]) + " m.",
        f"The friction circle of {used.grip:g} of the rear load is assumed; without one the linear column is "
        + ", ".join(_radius(drive.radius_m) for drive in free) + ".",
        _verdict(closest),
    )  # fmt: skip
    tables = (_guess_table(tried), _whole_table(drives, plain, closest))
    return Sheet("fixed", "Fixed steering (Table 4.1)", words, tuple(rows), _fixed_panels(drives, closest), tables)


def _radius_row(drive: Fixed, bare: Fixed, closest: Fixed) -> Comparison:
    thesis = TABLE_4_1[drive.model][ANGLES_DEG.index(drive.steering_deg)]
    note = f"without the engine's curve {_radius(bare.radius_m)}; closest hypothesis {_radius(closest.radius_m)}"
    if thesis is None:
        note = "the thesis: oversteer; " + note
    if not drive.stable:
        note = "ours: oversteer; " + note
    ours = drive.radius_m if drive.stable else None
    return Comparison(f"4.1 {drive.model} {drive.steering_deg:g} deg", "turning radius", "m", thesis, ours, note)


def _radius(value: float) -> str:
    return "oversteer" if math.isnan(value) else f"{value:.2f} m"


def _verdict(closest: Sequence[Fixed]) -> str:
    pairs = [(drive.radius_m, TABLE_4_1[drive.model][ANGLES_DEG.index(drive.steering_deg)]) for drive in closest]
    worst = max(abs(ours / thesis - 1.0) for ours, thesis in pairs if thesis is not None)
    column = ", ".join(_radius(drive.radius_m) for drive in closest[-len(ANGLES_DEG) :])
    return (
        "The non-linear column does not come out with this setting: the front tyres saturate first and the tractor "
        f"runs wide. The closest hypothesis ({BEST_GUESS}) gives {column} there and the whole table within "
        f"{100.0 * worst:.1f} %. It fits two numbers to the column, though, and leaves the engine's curve out, which "
        "Table 4.3 asks for, so it is not the setting used."
    )


def _guess_table(tried: Sequence[Guess]) -> TextTable:
    thesis = ("the thesis", *(f"{v:.2f} m" if v else "oversteer" for v in TABLE_4_1["nonlinear"]))
    rows = tuple((guess.words, *(_radius(value) for value in guess.radii_m)) for guess in tried)
    header = ("Hypothesis, non-linear model", "25 deg", "30 deg", "35 deg")
    return TextTable("What was tried for the non-linear column", header, (thesis, *rows))


def _whole_table(drives: Sequence[Fixed], plain: Sequence[Fixed], closest: Sequence[Fixed]) -> TextTable:
    rows = []
    for trio in zip(drives, plain, closest, strict=True):
        used = trio[0]
        thesis = TABLE_4_1[used.model][ANGLES_DEG.index(used.steering_deg)]
        shown = _radius(math.nan if thesis is None else thesis)
        rows.append((f"{used.model} {used.steering_deg:g} deg", shown, *(_radius(drive.radius_m) for drive in trio)))
    header = ("Drive", "Thesis", "With the curve (used)", "Without", "Closest hypothesis")
    return TextTable("Table 4.1 with and without the engine's friction curve", header, tuple(rows))


def _fixed_panels(drives: Sequence[Fixed], closest: Sequence[Fixed]) -> tuple[Panel, ...]:
    panels = []
    for model in dict.fromkeys(drive.model for drive in drives):
        mine = [drive for drive in drives if drive.model == model]
        panels.append(trajectory_panel(f"{model.capitalize()} model", {_angle(d): d.track for d in mine}))
    last = closest[-len(ANGLES_DEG) :]
    panels.append(trajectory_panel("Non-linear model, closest hypothesis", {_angle(d): d.track for d in last}))
    shown = (("linear model", drives[5]), ("non-linear model", drives[8]), ("closest hypothesis", last[-1]))
    for title, drive in shown:
        panels.append(slip_panel(f"Slip at 35 degrees, {title}", drive.track))
    return tuple(panels)


def _angle(drive: Fixed) -> str:
    return f"{drive.steering_deg:g} degrees"


def trajectory_panel(title: str, tracks: dict[str, Trace], seconds: float = SHOWN_S) -> Panel:
    """Tracks of the centre of mass to scale, each from its own start."""
    lines = []
    for number, (label, track) in enumerate(tracks.items()):
        place = track.place(0.0)[track.time_s <= seconds]
        lines.append(Line(label, place[:, 0] - place[0, 0], place[:, 1] - place[0, 1], number))
    return Panel(title, "East (m)", "North (m)", tuple(lines), equal=True)


def slip_panel(title: str, track: Trace, seconds: float = 15.0) -> Panel:
    """Slip angles of both axles over time."""
    part = track.time_s <= seconds
    time = track.time_s[part]
    front, rear = (np.degrees(slip)[part] for slip in track.slips())
    lines = (Line("front axle", time, front, 0), Line("rear axle", time, rear, 1))
    return Panel(title, "Time (s)", "Slip angle (degrees)", lines)


def changing(tractor: Tractor) -> Sheet:
    """Section 4.3.2: the steering swings as a sine; Fig. 4.7 is lost, so 35 degrees and 20 s are assumed."""
    tracks = changing_steering(tractor)
    first = next(iter(tracks.values()))
    steering = Line("all models", first.time_s, np.degrees(first.column("steering")), 0)
    slips = {model: np.degrees(np.abs(track.slips()[1])).max() for model, track in tracks.items()}
    spread = "; ".join(f"{model} {largest:.1f} degrees" for model, largest in slips.items())
    words = (
        "The steering swings between 35 degrees right and left with a period of 20 s (assumed; the figure is lost).",
        f"Largest slip of the rear axle: {spread}.",
    )
    panels = (
        Panel("Steering", "Time (s)", "Angle (degrees)", (steering,)),
        *(trajectory_panel(f"{model.capitalize()} model", {model: track}, 80.0) for model, track in tracks.items()),
    )
    return Sheet("changing", "Continuously changing steering (section 4.3.2)", words, (), panels)
