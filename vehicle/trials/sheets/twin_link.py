"""Section 5.3 as a sheet: a twin that follows a master over a link, by the thesis's method and by prediction.

The master drives the path of Fig. 5.4 on its own: a long straight, a corner to the left, a long straight. The slave, a
twin, gets late and sparse frames of the master: its commands and its pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats
from fields.units import KMH_PER_MPS
from vehicle.missions.plan import SWATH, Leg, LegTask, Mission
from vehicle.model.tractor import Implement, Tractor, load_tractor
from vehicle.trials.sheets.sheet import (
    ExperimentSheet,
    PlotLine,
    PlotPanel,
    TextTable,
    ThesisComparison,
    build_map_panel,
    build_time_panel,
)
from vehicle.twin.mismatch import ModelMismatch
from vehicle.twin.robot_tractor import RobotState, RobotTractor
from vehicle.twin.step_motion import TractorNoise
from vehicle.twin.twin import PREDICT, THESIS, PoseFix, Twin

# Fig. 5.4 has no scale; the thesis only gives the time of the corner, 60 to 80 s at 4 km/h (Fig. 5.7).
FIRST_STRAIGHT_M, CORNER_RADIUS_M, SECOND_STRAIGHT_M = 67.0, 10.0, 50.0
EXTENSION_M = 5.0
MASTER_HZ = 30  # divides the rates of the links below and their ages

LAN_AGE_S = 0.05  # assumed: "a tiny communication latency"
PRE_HZ, FIELD_HZ, FIELD_AGE_S = 10.0, 3.0, 0.3
PRE_MPS, FIELD_MPS = 4.0 / KMH_PER_MPS, 3.2 / KMH_PER_MPS
HIDDEN = {"steering_dead_time": 0.2, "wheel_slip": 0.05}
RATES_HZ, AGES_S = (1.0, 2.0, 3.0, 5.0, 10.0), (0.0, 0.1, 0.3, 0.6, 1.0)
TABLE_STRAIGHT_SHARE, TABLE_SAMPLE_HZ = 0.35, 5
AGREEMENT_M = 0.05  # m: "under most cases the trajectory difference would not be higher than 5 cm"
METHOD_NAMES = {THESIS: "thesis's method", PREDICT: "prediction"}
NOTHING_PRINTED = "the thesis has no such method"


@dataclass(frozen=True, eq=False)
class MasterDrive:
    """The drive of a master: the truth (t, 4) of time, antenna and heading, and the states reported at these times."""

    truth: Floats
    reported: tuple[RobotState, ...]


@dataclass(frozen=True, eq=False)
class LinkDeviation:
    """Twin less master at evenly spaced times (t,): distance (m), heading (rad), and across the master's path (m).

    `twin_path` (t, 2) is the path of the twin.
    """

    time_s: Floats
    distance_m: Floats
    heading_rad: Floats
    across_m: Floats
    twin_path: Floats


def build_corner_mission(speed_mps: float, straight_share: float = 1.0) -> Mission:
    """The path of Fig. 5.4: long straight, corner to the left, long straight; `straight_share` scales the straights."""
    angles = np.linspace(0.0, 0.5 * math.pi, 31)
    start_m = straight_share * FIRST_STRAIGHT_M
    arc = np.column_stack([CORNER_RADIUS_M * (np.cos(angles) - 1.0), start_m + CORNER_RADIUS_M * np.sin(angles)])
    end = arc[-1] - [straight_share * SECOND_STRAIGHT_M, 0.0]
    points = np.concatenate([[[0.0, 0.0]], arc, [end]])
    return Mission((Leg(points, speed_mps, ground="soil", task=LegTask(SWATH)),))


def drive_master(
    tractor: Tractor,
    speed_mps: float,
    *,
    hidden: Mapping[str, float] | None = None,
    noise: TractorNoise | None = None,
    seed: int = 1,
    straight_share: float = 1.0,
) -> MasterDrive:
    """Drive the path of build_corner_mission from standstill to its end; reported states have the noise."""
    mission = build_corner_mission(speed_mps, straight_share=straight_share)
    master = RobotTractor(mission, tractor, Implement(), hidden_effects=hidden, noise=noise, seed=seed)
    master.base_legs = 1
    truth, reported = [], []
    step = 0
    while not master.state.done:
        master.advance(step / MASTER_HZ)
        real = master.true_state
        truth.append((real.time_s, real.x_m, real.y_m, real.heading_rad))
        reported.append(master.state)
        step += 1
    return MasterDrive(np.array(truth), tuple(reported))


def simulate_twin_link(
    drive: MasterDrive,
    tractor: Tractor,
    method: str,
    *,
    rate_hz: float,
    age_s: float,
    sample_hz: int = 10,
    poses: bool = True,
) -> tuple[LinkDeviation, Twin]:
    """Let a twin of a tractor follow a drive by frames of this rate and age; returns the deviations and the twin.

    The two are compared `sample_hz` times a second. Without `poses` the twin only gets commands.
    """
    first_state = drive.reported[0]
    twin = Twin(tractor, Implement(), _build_fix(first_state, 0.0), method=method)
    frames = list(drive.reported[:: round(MASTER_HZ / rate_hz)])
    rows = []
    samples = drive.truth[:: MASTER_HZ // sample_hz]
    for real in samples:
        while frames and frames[0].time_s + age_s <= real[0] + 1e-9:
            frame = frames.pop(0)
            fix = _build_fix(frame, age_s)
            twin.advance(fix.arrived_s)
            twin.add_command(frame.time_s, frame.steering_command_rad, frame.speed_command_mps, frame.implement)
            if poses:
                twin.add_fix(fix)
        state = twin.advance(float(real[0]))
        rows.append((state.x_m, state.y_m, state.heading_rad))
    return _measure_deviation(drive, samples, np.array(rows)), twin


def _build_fix(state: RobotState, age_s: float) -> PoseFix:
    return PoseFix(state.time_s, state.x_m, state.y_m, state.heading_rad, state.speed_mps, state.time_s + age_s)


def _measure_deviation(drive: MasterDrive, real: Floats, twin: Floats) -> LinkDeviation:
    from shapely import LineString, distance, points

    _, x, y, angle = drive.truth[-1]
    # Straight beyond the end, for a twin that stops later than its master.
    beyond = [[x + EXTENSION_M * math.cos(angle), y + EXTENSION_M * math.sin(angle)]]
    line = LineString(np.concatenate([drive.truth[:: MASTER_HZ // 10, 1:3], beyond]))
    place, turned = twin[:, :2], twin[:, 2] - real[:, 3]
    apart, heading = np.hypot(*(place - real[:, 1:3]).T), np.arctan2(np.sin(turned), np.cos(turned))
    return LinkDeviation(real[:, 0], apart, heading, np.asarray(distance(points(place), line)), place)


def build_twin_sheet(master: Tractor, seed: int = 1) -> ExperimentSheet:
    """Both validations of section 5.3 with a master (EG105) and a slave (MR1000A), and tables of rates and ages."""
    slave = load_tractor("mr1000a")
    first = drive_master(master, PRE_MPS)
    pre = {method: simulate_twin_link(first, slave, method, rate_hz=PRE_HZ, age_s=LAN_AGE_S) for method in METHOD_NAMES}
    alone, _ = simulate_twin_link(first, slave, THESIS, rate_hz=PRE_HZ, age_s=LAN_AGE_S, poses=False)
    second, short = (
        drive_master(master, FIELD_MPS, hidden=HIDDEN, noise=TractorNoise(), seed=seed, straight_share=share)
        for share in (1.0, TABLE_STRAIGHT_SHARE)
    )
    field = {
        method: simulate_twin_link(second, slave, method, rate_hz=FIELD_HZ, age_s=FIELD_AGE_S)
        for method in METHOD_NAMES
    }
    grids = {method: _compute_rate_age_deviations(short, slave, method) for method in METHOD_NAMES}
    deviations = (
        {method: deviation for method, (deviation, _) in pre.items()},
        {method: deviation for method, (deviation, _) in field.items()},
    )
    mismatches = pre[PREDICT][1].find_mismatch(), field[PREDICT][1].find_mismatch()
    title = "Section 5.3: a virtual tractor that follows a real one over a link"
    words = _describe_results(*deviations, mismatches)
    comparisons = (*_compare_preliminary(deviations[0], alone), *_compare_field(deviations[1]))
    tables = tuple(_build_rate_age_table(grids[method], method) for method in METHOD_NAMES)
    return ExperimentSheet("twin", title, words, comparisons, _build_panels(first, *deviations, grids), tables)


def _compute_rate_age_deviations(drive: MasterDrive, slave: Tractor, method: str) -> tuple[np.ndarray, np.ndarray]:
    """Mean distance (m) and heading difference (degrees) per rate (rows) and age (columns)."""
    metres, degrees = np.empty((2, len(RATES_HZ), len(AGES_S)))
    for row, column in np.ndindex(metres.shape):
        rate, age = RATES_HZ[row], AGES_S[column]
        deviation, _ = simulate_twin_link(drive, slave, method, rate_hz=rate, age_s=age, sample_hz=TABLE_SAMPLE_HZ)
        metres[row, column], degrees[row, column] = deviation.distance_m.mean(), _compute_heading_deg(deviation)
    return metres, degrees


def _compute_heading_deg(deviation: LinkDeviation) -> float:
    return float(np.degrees(np.abs(deviation.heading_rad)).mean())


def _compare_preliminary(pre: dict[str, LinkDeviation], alone: LinkDeviation) -> tuple[ThesisComparison, ...]:
    rows, largest = [], "trajectory difference, largest"
    for method, deviation in pre.items():
        name = f"5.3.1 {METHOD_NAMES[method]}"
        printed = 14.5 if method == THESIS else None
        note = "" if method == THESIS else NOTHING_PRINTED
        share = 100.0 * float((deviation.across_m < AGREEMENT_M).mean())
        rows += [
            ThesisComparison(name, largest, "cm", printed, 100.0 * float(deviation.across_m.max()), note),
            ThesisComparison(name, "time with less than 5 cm", "%", None, share, note or 'printed as "most cases"'),
        ]
    words = "without any correction; the thesis has no such drive"
    last = 100.0 * float(alone.across_m.max())
    return (*rows, ThesisComparison("5.3.1 no correction", largest, "cm", None, last, words))


def _compare_field(field: dict[str, LinkDeviation]) -> tuple[ThesisComparison, ...]:
    rows = []
    for method, deviation in field.items():
        metres, degrees = deviation.distance_m, np.degrees(deviation.heading_rad)
        rows += [
            ThesisComparison(
                f"5.3.2 {METHOD_NAMES[method]}", quantity, unit, number if method == THESIS else None, float(ours),
                note if method == THESIS else NOTHING_PRINTED,
            )
            for quantity, unit, number, ours, note in (
                ("position difference, mean", "m", None, metres.mean(), "printed as 0.5 to 1 m most of the time"),
                ("position difference, largest", "m", None, metres.max(), "printed as a figure only"),
                ("heading difference, mean", "deg", None, np.abs(degrees).mean(), "printed as a range only"),
                ("heading difference, from lowest to highest", "deg", 6.0, np.ptp(degrees), ""),
            )
        ]  # fmt: skip
    return tuple(rows)


def _describe_results(
    pre: dict[str, LinkDeviation],
    field: dict[str, LinkDeviation],
    mismatches: tuple[ModelMismatch | None, ModelMismatch | None],
) -> tuple[str, ...]:
    master, slave = (load_tractor(name).get_power_law("soil") for name in ("eg105", "mr1000a"))
    angles = (-np.linspace(1.0, 35.0, 341)).tolist()
    wheel_angle_deg = min(angles, key=lambda angle: abs(master.compute_radius_m(angle) - CORNER_RADIUS_M))
    bend = 1.0 / slave.compute_radius_m(wheel_angle_deg) - 1.0 / CORNER_RADIUS_M
    drift = 50.0 * abs(bend) * PRE_MPS**2
    thesis, ours, sections = field[THESIS], field[PREDICT], ("5.3.1", "5.3.2")
    return (
        "5.3.1: the master is the EG105 on soil, the slave the MR1000A (Eq. 5.1), both simulated, 4 km/h. Assumed, as "
        "Fig. 5.4 has no scale: 67 m straight, a left corner of 10 m radius, 50 m straight; frames at 10 Hz and "
        f"{LAN_AGE_S:g} s old; corrections spread over 0.2 s.",
        f"The largest trajectory difference is {100 * pre[THESIS].across_m.max():.1f} cm by the thesis's method, "
        f"{100 * pre[PREDICT].across_m.max():.1f} cm by prediction; the thesis prints 14.5 cm. With the steering "
        f"curves of Eq. 2.10 and 5.1 a second without correction moves the slave {drift:.1f} cm aside in this corner, "
        "so 14.5 cm need several seconds, or another difference.",
        "5.3.2: the twin is the MR1000A at 3.2 km/h, with frames at 3 Hz and 0.3 s old, commands as late as positions. "
        "The real tractor's parameters are not printed; it is replaced by one with the steering curve of the EG105 on "
        "soil (Eq. 2.10), a steering dead time of 0.2 s and 5 % wheel slip. Noise: position 1.0 cm white and 1.5 cm "
        "slow drift, heading 0.11 and 0.10 degrees, speed 0.02 m/s, soil 0.0025 rad per m.",
        f"The mean difference of position and heading is {thesis.distance_m.mean():.2f} m and "
        f"{_compute_heading_deg(thesis):.2f} degrees by the thesis's method, {ours.distance_m.mean():.3f} m and "
        f"{_compute_heading_deg(ours):.2f} degrees by prediction. The printed 0.5 to 1 m are 0.6 to 1.1 s of driving: "
        "in the table below the thesis's method has them with frames 0.6 to 1 s old.",
        *(
            f"{section}: The twin's corrections do not exceed what noise explains."
            if mismatch is None
            else f"{section}: After {mismatch.detected_s:.0f} s the twin reports: {mismatch.words}"
            for section, mismatch in zip(sections, mismatches, strict=True)
        ),
    )


def _build_panels(
    first: MasterDrive,
    pre: dict[str, LinkDeviation],
    field: dict[str, LinkDeviation],
    grids: dict[str, tuple[np.ndarray, np.ndarray]],
) -> tuple[PlotPanel, ...]:
    lines = tuple(
        PlotLine(METHOD_NAMES[method], deviation.twin_path[:, 0], deviation.twin_path[:, 1], n + 1)
        for n, (method, deviation) in enumerate(pre.items())
    )
    master = PlotLine("master", first.truth[:, 1], first.truth[:, 2], 0, dashed=True)
    ages = tuple(
        PlotLine(f"{METHOD_NAMES[method]}, {RATES_HZ[row]:g} Hz", np.array(AGES_S), grids[method][0][row], n, dashed)
        for n, method in enumerate(METHOD_NAMES)
        for row, dashed in ((2, False), (4, True))
    )
    across = _build_lines(pre, lambda deviation: 100 * deviation.across_m)
    distances = _build_lines(field, lambda deviation: deviation.distance_m)
    headings = _build_lines(field, lambda deviation: np.degrees(deviation.heading_rad))
    short = "5.3.2 on shorter straights: mean position difference"
    return (
        build_map_panel("5.3.1: paths", (master, *lines)),
        build_time_panel("5.3.1: trajectory difference", "Difference (cm)", across),
        build_time_panel("5.3.2: position difference", "Difference (m)", distances),
        build_time_panel("5.3.2: heading difference", "Difference (degrees)", headings),
        PlotPanel(short, "Age of frames (s)", "Difference (m)", ages),
    )


def _build_lines(
    deviations: dict[str, LinkDeviation], get_values: Callable[[LinkDeviation], Floats]
) -> tuple[PlotLine, ...]:
    """A line over time per method."""
    return tuple(
        PlotLine(METHOD_NAMES[method], deviation.time_s, get_values(deviation), number)
        for number, (method, deviation) in enumerate(deviations.items())
    )


def _build_rate_age_table(grid: tuple[np.ndarray, np.ndarray], method: str) -> TextTable:
    header = ("Hz", *(f"{age:g} s old" for age in AGES_S))
    rows = tuple(
        (f"{rate:g}", *(f"{100 * metres:.1f} / {degrees:.2f}" for metres, degrees in zip(*line, strict=True)))
        for rate, *line in zip(RATES_HZ, *grid, strict=True)
    )
    title = "mean difference of position (cm) / heading (deg) by rate and age of frames"
    return TextTable(f"5.3.2 on shorter straights, {METHOD_NAMES[method]}: {title}", header, rows)
