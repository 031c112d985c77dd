"""`headland tractor check`: drives that show whether the values of a tractor file fit together.

Expected and driven values are compared for circles, a straight swath, a change of lane and a turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from fields.arrays import Floats, build_directions
from fields.units import HOUR_S, KILO, MINUTE_S
from vehicle.energy.fuel import ElectricDrive, build_power_source
from vehicle.errors import VehicleError
from vehicle.missions.plan import SWATH, TURN, Leg, LegTask, Mission, Plan
from vehicle.missions.run import DONE
from vehicle.model.gnss import load_default_error_table
from vehicle.model.ground import list_ground_names
from vehicle.model.tractor import RADIUS_FACTOR, Implement, Tractor, remove_log_corrections
from vehicle.sim.calibration import CIRCLE_SPEED_MPS, SteeringCircle, drive_circle
from vehicle.sim.world import simulate
from vehicle.trials.drive import build_straight_mission, follow_mission
from vehicle.trials.sheets.sheet import (
    DriveCheck,
    ExperimentSheet,
    PlotLine,
    PlotPanel,
    TextTable,
    TractorVerdict,
    build_map_panel,
    build_track_line,
)

TRIAL_GROUND = "soil"
LANE_M, LANE_AT_M, LANE_TOLERANCE_M = 1.0, 20.0, 0.05
PATH_LENGTH_M, SETTLING_M = 100.0, 20.0
APPROACH_LENGTH_M, EXIT_LENGTH_M, MAX_DRIVE_S = 15.0, 25.0, 600.0
CIRCLE_TOLERANCE_SHARE, ACKERMANN_TOLERANCE_SHARE = 0.01, 0.35
MAX_WEAVING_CM, MAX_SETTLING_M, MAX_OVERSHOOT_CM, MAX_DEVIATION_M = 5.0, 30.0, 50.0, 1.0
RADIUS_ADVICE = "look at [radius]"
AXLE_ADVICE = "look at [radius], max_steering_deg, front_axle_m and rear_axle_m: one of them does not fit the others"
GUIDANCE_ADVICE = "look at [guidance] and at steering.rate_deg_per_s"
TURN_ADVICE = "look at steering.rate_deg_per_s and guidance.turn_lookahead_m, or drive turns slower"
EXPECTED_COLOUR = 4


@dataclass(frozen=True, eq=False)
class CircleTrial:
    """A circle at a fixed wheel angle (degrees, positive right), and the radius expected from the file (m)."""

    ground: str
    steering_deg: float
    expected_m: float
    circle: SteeringCircle


@dataclass(frozen=True, eq=False)
class LaneTrial:
    """A straight path, and a change to a lane LANE_M to its right.

    `weaving_m` is the largest error in the second half of the straight path, with RTK position errors; `settled_m` the
    distance until the error in the lane stays within LANE_TOLERANCE_M (None: never), `overshoot_m` the largest distance
    beyond the lane.
    """

    path: Floats
    weaving_m: float
    settled_m: float | None
    overshoot_m: float


@dataclass(frozen=True, eq=False)
class HalfCircleTrial:
    """A half circle between two swaths: radius, path, driven path (t, 2), and its largest deviation (None: stuck)."""

    radius_m: float
    path: Floats
    driven_path: Floats
    deviation_m: float | None


def drive_circles(tractor: Tractor) -> tuple[CircleTrial, ...]:
    """Full and half lock to both sides on every ground with radii in the file, without corrections from logs.

    The simulation applies effects from logs in addition to [radius].
    """
    tractor, lock = remove_log_corrections(tractor), tractor.max_steering_deg
    return tuple(
        CircleTrial(ground, angle, tractor.radius[ground].compute_radius_m(angle), drive_circle(tractor, angle, ground))
        for ground in list_ground_names()
        if ground in tractor.radius
        for angle in (lock, -lock, 0.5 * lock, -0.5 * lock)
    )


def drive_lane_change(tractor: Tractor) -> LaneTrial:
    """A straight path, then a lane beside it, at the thesis's speed on soil."""
    seconds = PATH_LENGTH_M / CIRCLE_SPEED_MPS
    path = build_straight_mission(PATH_LENGTH_M, CIRCLE_SPEED_MPS, TRIAL_GROUND)
    first = follow_mission(tractor, path, seconds=seconds, position_errors=load_default_error_table()).compute_path()
    weaving = np.abs(first[first[:, 1] > 0.5 * PATH_LENGTH_M, 0])
    jump = (LANE_AT_M, LANE_M)
    path_driven = follow_mission(tractor, path, seconds=2.0 * seconds, jump=jump).compute_path()
    end = PATH_LENGTH_M - SETTLING_M
    far = np.nonzero((np.abs(path_driven[:, 0] - LANE_M) > LANE_TOLERANCE_M) & (path_driven[:, 1] < end))[0]
    reached = bool((path_driven[:, 1] >= end).any())
    settled = float(path_driven[far[-1], 1]) - LANE_AT_M if reached else math.inf
    is_settled = settled < end - LANE_AT_M - 1.0
    beyond = max(float(path_driven[:, 0].max()) - LANE_M, 0.0)
    return LaneTrial(path_driven, float(weaving.max(initial=0.0)), settled if is_settled else None, beyond)


def drive_half_circle(tractor: Tractor) -> HalfCircleTrial:
    """From one swath to another by a half circle as wide as in plans."""
    radius = RADIUS_FACTOR * tractor.compute_smallest_radius_m(TRIAL_GROUND)
    turned = np.linspace(0.0, math.pi, 91)
    arc = radius * np.stack([1.0 - np.cos(turned), np.sin(turned)], axis=1)
    across = 2.0 * radius
    pieces = (
        np.array([[0.0, -APPROACH_LENGTH_M], [0.0, 0.0]]),
        arc,
        np.array([[across, 0.0], [across, -EXIT_LENGTH_M]]),
    )
    legs = tuple(
        Leg(points, CIRCLE_SPEED_MPS, ground=TRIAL_GROUND, task=LegTask(kind), implement=kind == SWATH)
        for points, kind in zip(pieces, (SWATH, TURN, SWATH), strict=True)
    )
    run = simulate(Plan((Mission(legs),)), tractor, Implement(), max_time_s=MAX_DRIVE_S)
    path, poses = np.concatenate(pieces), run.get_poses(0)
    driven_path = poses[:, :2] + tractor.guide_m * build_directions(poses[:, 2])
    distances_m = shapely.distance(shapely.points(driven_path), shapely.LineString(path))
    return HalfCircleTrial(radius, path, driven_path, float(distances_m.max()) if run.outcome == DONE else None)


def check_tractor(tractor: Tractor) -> tuple[TractorVerdict, ExperimentSheet]:
    """The verdict on a tractor file, and its sheet.

    Raises VehicleError for a tractor without turning radii on soil.
    """
    if TRIAL_GROUND not in tractor.radius:
        raise VehicleError(
            f"{tractor.name} has no turning radii on {TRIAL_GROUND}, the ground of fields; add [radius.{TRIAL_GROUND}] "
            "with right and left, usually the radii on asphalt or up to a tenth more."
        )
    circle_trials, lane, half = drive_circles(tractor), drive_lane_change(tractor), drive_half_circle(tractor)
    checks = (*_check_circles(tractor, circle_trials), *_check_guidance(lane, half))
    words = _describe_verdict(tractor, checks)
    verdict = TractorVerdict(tractor.name, all(check.is_good for check in checks), words, checks)
    header = ("Drive", "Ground", "Expected", "Driven", "Difference", "Good")
    table = TextTable("Expected and driven", header, tuple(map(_build_row, checks)))
    half_title = f"A half circle of {half.radius_m:.2f} m between swaths, {APPROACH_LENGTH_M:g} m before it"
    half_panel = build_map_panel(f"{half_title}, on {TRIAL_GROUND}", _build_lines(half.driven_path, half.path))
    far = LANE_AT_M + 2.0 * MAX_SETTLING_M
    part = lane.path[(lane.path[:, 1] > 0.0) & (lane.path[:, 1] < far)]
    path = np.array([[0.0, 0.0], [LANE_AT_M, 0.0], [LANE_AT_M, LANE_M], [far, LANE_M]])
    lane_title = f"A lane {LANE_M:g} m to the right, on {TRIAL_GROUND}"
    lane_panel = PlotPanel(lane_title, "Along (m)", "To the right (m)", _build_lines(part[:, ::-1], path))
    panels = (*_build_circle_panels(circle_trials), lane_panel, half_panel)
    sentences = (*verdict.words, describe_radius_reference(tractor))
    return verdict, ExperimentSheet("proved", f"Check of {tractor.name}", sentences, (), panels, (table,))


def describe_radius_reference(tractor: Tractor) -> str:
    """Whose circle a radius of the file is, and how to get it from that of the middle of the rear axle."""
    ahead_m, side = abs(tractor.antenna_forward_m), "ahead of" if tractor.antenna_forward_m >= 0.0 else "behind"
    return (
        f"Radii are of the circle of the antenna, {ahead_m:.2f} m {side} the rear axle: R_antenna^2 = R_rear^2 + "
        f"{ahead_m:.2f}^2, with R_rear of the middle of the rear axle."
    )


def _check_circles(tractor: Tractor, circle_trials: Sequence[CircleTrial]) -> Iterator[DriveCheck]:
    for trial in circle_trials:
        lock = "full lock" if abs(trial.steering_deg) == tractor.max_steering_deg else "half lock"
        side = "right" if trial.steering_deg > 0 else "left"
        drive = f"circle {side}, {lock}, {abs(trial.steering_deg):.1f} degrees"
        expected_m, tolerance_m = trial.expected_m, CIRCLE_TOLERANCE_SHARE * trial.expected_m
        yield DriveCheck(drive, trial.ground, "m", expected_m, trial.circle.radius_m, tolerance_m, RADIUS_ADVICE)
    ground, expected_m = "asphalt" if "asphalt" in tractor.radius else TRIAL_GROUND, tractor.ackermann_radius_m
    radius_m, tolerance_m = tractor.compute_smallest_radius_m(ground), ACKERMANN_TOLERANCE_SHARE * expected_m
    drive = "radius at full lock, from wheelbase and wheel angle and in the file"
    yield DriveCheck(drive, ground, "m", expected_m, radius_m, tolerance_m, AXLE_ADVICE)


def _check_guidance(lane: LaneTrial, half: HalfCircleTrial) -> Iterator[DriveCheck]:
    weaving_cm, beyond_cm = 100.0 * lane.weaving_m, 100.0 * lane.overshoot_m
    lane_words = f"lane {LANE_M:g} m to the right: distance until within 5 cm"
    half_words = f"half circle of {half.radius_m:.2f} m between swaths: largest deviation"
    for drive, unit, driven, tolerance, advice in (
        ("straight path, RTK: largest error", "cm", weaving_cm, MAX_WEAVING_CM, GUIDANCE_ADVICE),
        (lane_words, "m", lane.settled_m, MAX_SETTLING_M, GUIDANCE_ADVICE),
        ("the same: overshoot", "cm", beyond_cm, MAX_OVERSHOOT_CM, GUIDANCE_ADVICE),
        (half_words, "m", half.deviation_m, MAX_DEVIATION_M, TURN_ADVICE),
    ):
        yield DriveCheck(drive, TRIAL_GROUND, unit, 0.0, driven, tolerance, advice)


def _build_row(check: DriveCheck) -> tuple[str, ...]:
    deviation = check.difference
    if check.expected == 0.0:
        expected, difference = f"{check.tolerance:g} {check.unit} or less", ""
    else:
        expected = f"{check.expected:.2f} {check.unit}"
        difference = "" if deviation is None else f"{round(100.0 * deviation / check.expected, 1) + 0.0:+.1f} %"
    driven = "not finished" if check.driven is None else f"{check.driven:.2f} {check.unit}"
    return check.drive, check.ground, expected, driven, difference, "yes" if check.is_good else "no"


def _describe_verdict(tractor: Tractor, checks: Sequence[DriveCheck]) -> tuple[str, ...]:
    """The verdict, advice for each drive that is not good, and the number of assumed values."""
    wrong = [check for check in checks if not check.is_good]
    assumed = sorted(key for key, words in tractor.source.items() if "assumed" in words)
    first = (
        f"The values fit together: {tractor.name} drives as its file says, at 5 km/h."
        if not wrong
        else f"The values do not fit together: {len(wrong)} of {len(checks)} drives are not as the file says."
    )
    advice = tuple(
        f"{check.drive[0].upper()}{check.drive[1:]} on {check.ground}: {_build_row(check)[3]} instead of "
        f"{_build_row(check)[2]}; {check.advice}."
        for check in wrong
    )
    effect_note, battery_note = "", describe_electric_drive(tractor)
    if tractor.effects:
        radius = drive_circle(tractor, tractor.max_steering_deg, TRIAL_GROUND).radius_m
        effect_note = (
            f"Effects from logs in the file: {', '.join(tractor.effects)}; with them full lock to the right drives "
            f"{radius:.2f} m on {TRIAL_GROUND}. The circles here are without them, the other drives with them."
        )
    assumption_note = f"Assumed values, not measured: {len(assumed)} of {len(tractor.source)}." if assumed else ""
    return (first, *advice, *(text for text in (effect_note, battery_note, assumption_note) if text))


def describe_electric_drive(tractor: Tractor) -> str:
    """Battery and motor in a sentence; "" for a diesel tractor."""
    if tractor.battery is None or tractor.engine is None:
        return ""
    drive = build_power_source(tractor, KILO * tractor.engine.power_kw)
    assert isinstance(drive, ElectricDrive)
    battery = drive.battery
    full_h = drive.usable_kwh * battery.efficiency / tractor.engine.power_kw
    filled = (
        f"charging that takes {drive.compute_charge_s(drive.usable_kwh) / HOUR_S:.1f} h at {battery.charger_kw:g} kW"
        if battery.change_s is None
        else f"changing the battery takes {battery.change_s / MINUTE_S:.0f} min"
    )
    return (
        f"Electric: {drive.usable_kwh:.3g} of {battery.capacity_kwh:g} kWh can be used, enough for {full_h:.1f} h at "
        f"the full {tractor.engine.power_kw:g} kW of the motor; {filled}."
    )


def _build_circle_panels(circle_trials: Sequence[CircleTrial]) -> Iterator[PlotPanel]:
    """The circles on each ground, and those of the expected radius round the centres of the circles at the end."""
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    for ground in dict.fromkeys(trial.ground for trial in circle_trials):
        lines = []
        for number, trial in enumerate(circle_trial for circle_trial in circle_trials if circle_trial.ground == ground):
            side = "right" if trial.steering_deg > 0 else "left"
            label = f"{abs(trial.steering_deg):.1f} degrees {side}, {trial.expected_m:.2f} m expected"
            track = trial.circle.antenna_path
            ahead = track[-1] - track[-2]
            aside = np.array([ahead[1], -ahead[0]]) / max(float(np.hypot(*ahead)), 1e-9)
            middle = track[-1] - track[0] + np.copysign(trial.circle.radius_m, trial.steering_deg) * aside
            x, y = middle[0] + trial.expected_m * np.cos(turn), middle[1] + trial.expected_m * np.sin(turn)
            # Underscore: matplotlib leaves it out of the legend, where the driven line names the expected radius.
            expected = PlotLine("_expected", x, y, EXPECTED_COLOUR, dashed=True)
            lines += [build_track_line(label, track, number), expected]
        yield build_map_panel(f"Circles on {ground}; dashed: expected", lines)


def _build_lines(driven_path: Floats, path: Floats) -> tuple[PlotLine, PlotLine]:
    """The driven path (t, 2), and the expected one (n, 2) dashed."""
    expected = PlotLine("expected", path[:, 0], path[:, 1], EXPECTED_COLOUR, dashed=True)
    return PlotLine("driven", driven_path[:, 0], driven_path[:, 1], 0), expected
