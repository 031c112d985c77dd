"""Experiments along paths, and the errors of driven paths.

The step response of section 3.2 from one straight path to another, zigzag paths (section 3.3 with the corrected base
model, section 4.4 with the tyres of chapter 4), and the navigation plan of section 3.4: yard, U-turn, two passes on
soil and a switch-back between them. The coordinates of that plan are not printed; its lengths are assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fields.arrays import Flags, Floats, Integers, locate_at, measure_along
from vehicle.control.steering import SLEW
from vehicle.missions.plan import SWATH, TURN, Leg, LegTask, Mission
from vehicle.model.gnss import NO_ERROR
from vehicle.model.ground import ENGINE_CURVE, FrictionCurve, get_tyres
from vehicle.model.tractor import Tractor
from vehicle.sim.calibration import CIRCLE_SPEED_MPS
from vehicle.trials.drive import (
    CONTROLLED_POINT_M,
    LOOKAHEAD_M,
    RUN_OUT_M,
    SLIP_LOOKAHEAD_M,
    UNLIMITED_M,
    Trace,
    build_sine_mission,
    build_straight_mission,
    configure_tractor,
    follow_mission,
)

YARD_M, PASS_M, TURN_RADIUS_M, SPACING_M, YARD_RADIUS_M = 20.0, 167.0, 4.5, 3.0, 6.0
FIRST_PASS, SECOND_PASS = 2, 6
UNMEASURED_END_M = 3.0  # the last metres before a stop are not measured
OFFSETS_CM = (-200, -150, -100, -50, 50, 100, 150, 200)
SPEEDS_KMH = (3.0, 5.0)
FIRST_PATH_M = 20.0
SECOND_PATH_M = 28.0  # not printed: assumed
MEASURED_LENGTH_M = 15.0
AMPLITUDE_M = 5.0
OMEGAS = (1 / 5, 1 / 4, 1 / 3)
HALF_PERIOD_M = 18.8  # section 4.4
PERIODS = 2.0


class ErrorSizes(NamedTuple):
    """Largest and mean lateral error (m or cm) and heading error (degrees)."""

    lateral_max: float
    lateral_mean: float
    heading_max_deg: float
    heading_mean_deg: float


@dataclass(frozen=True, eq=False)
class PathDeviation:
    """Errors of a driven path, (t,) each: distance along the path (m), lateral error (m, positive if the path lies to
    the right) and heading error (rad, positive if the target point lies to the right of the tractor's heading).
    """

    along_m: Floats
    lateral_m: Floats
    heading_rad: Floats

    def select(self, rows: Any) -> PathDeviation:
        """The errors of some rows."""
        return PathDeviation(self.along_m[rows], self.lateral_m[rows], self.heading_rad[rows])

    def compute_sizes(self, per_m: float = 1.0) -> ErrorSizes:
        """Sizes, the lateral ones in a unit of which a metre has `per_m`."""
        lateral, heading = per_m * np.abs(self.lateral_m), np.degrees(np.abs(self.heading_rad))
        return ErrorSizes(float(lateral.max()), float(lateral.mean()), float(heading.max()), float(heading.mean()))


def compute_deviation(place: Floats, angle: Floats, path: Floats, lookahead_m: float) -> PathDeviation:
    """Errors of places (t, 2) with headings (t,) against the polyline `path` (n, 2), searched forwards only.

    The heading error is that of section 2.2.3, to the point of the path `lookahead_m` beyond the projection. The search
    for each place starts at the segment of the one before and covers 5 m of path.
    """
    step = np.diff(path, axis=0)
    length = np.hypot(*step.T)
    unit = step / length[:, None]
    start = measure_along(path)
    ahead = max(2, int(np.ceil(5.0 / max(float(np.median(length)), 1e-9))))
    along, lateral = np.empty(len(place)), np.empty(len(place))
    segment = 0
    for row, point in enumerate(place):
        window = slice(segment, min(segment + ahead, len(step)))
        relative = point - path[window]
        run = np.clip((relative * unit[window]).sum(axis=1), 0.0, length[window])
        offset = int(np.argmin(np.hypot(*(relative - run[:, None] * unit[window]).T)))
        segment += offset
        (ux, uy), (rx, ry) = unit[segment], relative[offset]
        along[row], lateral[row] = start[segment] + rx * ux + ry * uy, ux * ry - uy * rx
    target = locate_at(path, start, along + lookahead_m) - place
    turned = angle - np.arctan2(target[:, 1], target[:, 0])
    return PathDeviation(along, lateral, np.arctan2(np.sin(turned), np.cos(turned)))


def measure_gap_m(path: Floats, other_path: Floats) -> tuple[float, float]:
    """Largest and mean distance (m) of every sixth point of a path (ten a second at 60 Hz) from another path, as in
    Tables 3.1 and 3.2. The other path is reduced to every third point, which moves it by less than a millimetre.
    """
    from shapely import LineString, distance, points

    gaps_m = distance(points(path[::6]), LineString(np.concatenate([other_path[::3], other_path[-1:]])))
    return float(gaps_m.max()), float(gaps_m.mean())


def find_slewing(trace: Trace) -> Flags:
    """In which steps (t,) the steering simulator is in its third stage."""
    return np.asarray(trace.get_column("stage") == SLEW)


@dataclass(frozen=True, eq=False)
class NavigationPasses:
    """The navigation drive, and the errors (cm) of both passes."""

    mission: Mission
    trace: Trace
    sizes: tuple[ErrorSizes, ...]


def build_navigation_mission() -> Mission:
    """Yard, U-turn, pass 1, quarter turn, straight back, quarter turn, pass 2; passes on soil, all else on asphalt."""
    speed, top = CIRCLE_SPEED_MPS, PASS_M
    start = -2.0 * YARD_RADIUS_M
    across = 2.0 * TURN_RADIUS_M - SPACING_M

    def build_leg(points: Floats, **more: object) -> Leg:
        return Leg(points, **{"speed_mps": speed, "ground": "asphalt", "task": LegTask(TURN), **more})  # type: ignore[arg-type]

    yard = np.array([[start, YARD_M], [start, 0.0]])
    u_turn = _build_arc((start + YARD_RADIUS_M, 0.0), YARD_RADIUS_M, 180.0, 360.0)
    first = np.array([[0.0, 0.0], [0.0, top]])
    out = _build_arc((TURN_RADIUS_M, top), TURN_RADIUS_M, 180.0, 90.0)
    back = np.array([[TURN_RADIUS_M, top + TURN_RADIUS_M], [TURN_RADIUS_M - across, top + TURN_RADIUS_M]])
    into = _build_arc((TURN_RADIUS_M - across, top), TURN_RADIUS_M, 90.0, 0.0)
    x = float(into[-1, 0])
    second = np.array([[x, top], [x, 0.0]])
    work = {"ground": "soil", "task": LegTask(SWATH)}
    back_leg = build_leg(back, gear=-1, speed_mps=1.0)
    first_leg, second_leg = build_leg(first, **work), build_leg(second, **work)
    return Mission(
        (build_leg(yard), build_leg(u_turn), first_leg, build_leg(out), back_leg, build_leg(into), second_leg)
    )


def drive_navigation(tractor: Tractor, *, position_errors: Integers = NO_ERROR, seed: int = 1) -> NavigationPasses:
    """Drive the navigation plan with 5 m lookahead and measure both passes."""
    mission, tested = build_navigation_mission(), configure_tractor(tractor)
    trace = follow_mission(tested, mission, position_errors=position_errors, seed=seed, seconds=900.0)
    place, angle, sizes = trace.compute_path(), trace.get_column("angle"), []
    for number in (FIRST_PASS, SECOND_PASS):
        rows, leg = trace.get_column("leg") == number, mission.legs[number]
        errors = compute_deviation(place[rows], angle[rows], leg.points, LOOKAHEAD_M)
        part = errors.along_m < leg.length_m - max(UNMEASURED_END_M, LOOKAHEAD_M)
        sizes.append(errors.select(part).compute_sizes(100.0))
    return NavigationPasses(mission, trace, tuple(sizes))


def _build_arc(centre: tuple[float, float], radius: float, start_deg: float, end_deg: float) -> Floats:
    angles = np.radians(np.linspace(start_deg, end_deg, max(3, round(abs(end_deg - start_deg) / 3.0)) + 1))
    return np.stack([centre[0] + radius * np.cos(angles), centre[1] + radius * np.sin(angles)], axis=1)


@dataclass(frozen=True, eq=False)
class StepResponse:
    """The trace of one step response; positive offsets are to the right."""

    offset_cm: int
    trace: Trace
    second_m: float = SECOND_PATH_M

    @property
    def mean_lateral_error_cm(self) -> float:
        """Mean size of the lateral error over the last 15 m of path 2, in centimetres."""
        place = self.trace.compute_path()
        end = FIRST_PATH_M + self.second_m
        last = (place[:, 1] > end - MEASURED_LENGTH_M) & (place[:, 1] < end)
        return float(100.0 * np.abs(place[last, 0] - 0.01 * self.offset_cm).mean())

    @property
    def enters_third_stage(self) -> bool:
        """Whether the steering simulator enters its third stage."""
        is_measured = self.trace.compute_path()[:, 1] < FIRST_PATH_M + self.second_m
        return bool(find_slewing(self.trace)[is_measured].any())

    def compute_difference_cm(self, response: StepResponse) -> tuple[float, float]:
        """Largest and mean distance (cm) of this path from another, from the first turn to the last 15 m."""
        place = self.trace.compute_path()
        turning = (place[:, 1] > FIRST_PATH_M - 6.0) & (place[:, 1] < FIRST_PATH_M + self.second_m - MEASURED_LENGTH_M)
        largest_m, mean_m = measure_gap_m(place[turning], response.trace.compute_path())
        return 100.0 * largest_m, 100.0 * mean_m


def drive_step_response(
    tractor: Tractor,
    offset_cm: int,
    speed_kmh: float,
    ground: str,
    steering: str = "proposed",
    *,
    position_errors: Integers = NO_ERROR,
    seed: int = 1,
    limit_m: float = UNLIMITED_M,
    second_m: float = SECOND_PATH_M,
) -> StepResponse:
    """Drive one step response with the corrected base model of a ground."""
    path = build_straight_mission(FIRST_PATH_M + second_m + RUN_OUT_M, speed_kmh / 3.6, ground)
    tested, jump = configure_tractor(tractor, steering, limit_m=limit_m), (FIRST_PATH_M, 0.01 * offset_cm)
    trace = follow_mission(tested, path, position_errors=position_errors, seed=seed, jump=jump)
    return StepResponse(offset_cm, trace, second_m)


def measure_weaving_m(tractor: Tractor, offset_cm: int, *, limit_m: float) -> float:
    """Largest lateral error (m) in the third minute after a start `offset_cm` beside a straight path on soil.

    Unlike in the step response, the lookahead point does not move first: the full offset applies at once.
    """
    path = build_straight_mission(1000.0, CIRCLE_SPEED_MPS, "soil")
    tested = configure_tractor(tractor, limit_m=limit_m)
    trace = follow_mission(tested, path, seconds=180.0, jump=(0.1, 0.01 * offset_cm))
    late = trace.time_s > 120.0
    return float(np.abs(trace.compute_path()[late, 0] - 0.01 * offset_cm).max())


@dataclass(frozen=True, eq=False)
class PathTracking:
    """A driven path and its errors (m), up to where the run-out of the path begins."""

    trace: Trace
    errors: PathDeviation
    sizes: ErrorSizes


def measure_tracking(trace: Trace, path: Mission, lookahead_m: float) -> PathTracking:
    """Measure a trace against the first leg of a path, up to its run-out."""
    points = path.legs[0].points
    errors = compute_deviation(trace.compute_path(), trace.get_column("angle"), points, lookahead_m)
    end = int(np.argmax(np.append(errors.along_m, np.inf) >= path.legs[0].length_m - RUN_OUT_M))
    errors, trace = errors.select(slice(end)), replace(trace, time_s=trace.time_s[:end], rows=trace.rows[:end])
    return PathTracking(trace, errors, errors.compute_sizes())


def drive_slip_test(
    tractor: Tractor,
    ground: str,
    model: str,
    *,
    curve: FrictionCurve | None = ENGINE_CURVE,
    point_m: float = CONTROLLED_POINT_M,
) -> PathTracking:
    """Section 4.4: the wave of 37.6 m and 5 m at 5 km/h with 1.8 m lookahead, without corrected angles."""
    tested = configure_tractor(tractor, lookahead_m=SLIP_LOOKAHEAD_M, point_m=point_m)
    path = build_sine_mission(AMPLITUDE_M, math.pi / HALF_PERIOD_M, PERIODS, CIRCLE_SPEED_MPS, "asphalt")
    trace = follow_mission(tested, path, tyres=get_tyres(ground, model, curve=curve), seconds=180.0)
    return measure_tracking(trace, path, SLIP_LOOKAHEAD_M)


def drive_zigzag(
    tractor: Tractor, omega: float, steering: str = "proposed", *, lookahead_m: float = LOOKAHEAD_M
) -> PathTracking:
    """Section 3.3 at 5 km/h, the path of Eq. 3.1 with the corrected base model."""
    path = build_sine_mission(AMPLITUDE_M, omega, PERIODS, CIRCLE_SPEED_MPS, "soil")
    trace = follow_mission(configure_tractor(tractor, steering, lookahead_m=lookahead_m), path, seconds=240.0)
    return measure_tracking(trace, path, lookahead_m)
