"""The real navigation plan of section 3.4: yard, U-turn, two passes on soil, a switch-back between them.

The field's coordinates are not printed; the shape follows the text, with the lengths below assumed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vehicle.circles import CIRCLE_SPEED_MPS
from vehicle.gnss import NO_ERROR, Table
from vehicle.missions import TRACK, TURN, Leg, Mission, Task
from vehicle.tractor import Tractor
from vehicle.trials.deviation import deviation
from vehicle.trials.drive import Trace, follow
from vehicle.trials.setting import STEP_LOOKAHEAD_M, as_tested

Array = npt.NDArray[np.float64]
YARD_M, PASS_M, RADIUS_M, SPACING_M, YARD_RADIUS_M = 20.0, 167.0, 4.5, 3.0, 6.0
BACK_MPS = 1.0
FIRST_PASS, SECOND_PASS = 2, 6
END_M = 3.0  # the last metres before a stop are not measured


@dataclass(frozen=True, eq=False)
class Passes:
    """The drive, and per pass the largest and mean lateral error (cm) and heading error (degrees)."""

    mission: Mission
    track: Trace
    lateral_max_cm: tuple[float, float]
    lateral_mean_cm: tuple[float, float]
    heading_max_deg: tuple[float, float]
    heading_mean_deg: tuple[float, float]


def navigation_mission() -> Mission:
    """Yard, U-turn, pass 1, quarter turn, straight back, quarter turn, pass 2; passes on soil, rest on asphalt."""
    speed, top = CIRCLE_SPEED_MPS, PASS_M
    start = -2.0 * YARD_RADIUS_M
    across = 2.0 * RADIUS_M - SPACING_M

    def leg(points: Array, **more: object) -> Leg:
        return Leg(points, **{"speed_mps": speed, "ground": "asphalt", "task": Task(TURN), **more})  # type: ignore[arg-type]

    yard = np.array([[start, YARD_M], [start, 0.0]])
    u_turn = _arc((start + YARD_RADIUS_M, 0.0), YARD_RADIUS_M, 180.0, 360.0)
    first = np.array([[0.0, 0.0], [0.0, top]])
    out = _arc((RADIUS_M, top), RADIUS_M, 180.0, 90.0)
    back = np.array([[RADIUS_M, top + RADIUS_M], [RADIUS_M - across, top + RADIUS_M]])
    into = _arc((RADIUS_M - across, top), RADIUS_M, 90.0, 0.0)
    x = float(into[-1, 0])
    second = np.array([[x, top], [x, 0.0]])
    work = {"ground": "soil", "task": Task(TRACK)}
    return Mission((
        leg(yard), leg(u_turn), leg(first, **work), leg(out), leg(back, gear=-1, speed_mps=BACK_MPS), leg(into),
        leg(second, **work),
    ))  # fmt: skip


def navigation(
    tractor: Tractor, *, position_errors: Table = NO_ERROR, seed: int = 1, steering: str = "proposed"
) -> Passes:
    """Drive the plan with 5 m lookahead and measure both passes."""
    mission = navigation_mission()
    track = follow(as_tested(tractor, steering), mission, position_errors=position_errors, seed=seed, seconds=900.0)
    found = np.array([_pass_errors(mission, track, leg) for leg in (FIRST_PASS, SECOND_PASS)])
    pairs = [(float(found[0, column]), float(found[1, column])) for column in range(4)]
    return Passes(mission, track, *pairs)


def _pass_errors(mission: Mission, track: Trace, leg: int) -> tuple[float, float, float, float]:
    rows = track.column("leg") == leg
    points = mission.legs[leg].points
    errors = deviation(track.place()[rows], track.column("angle")[rows], points, STEP_LOOKAHEAD_M)
    part = errors.along < mission.legs[leg].length_m - max(END_M, STEP_LOOKAHEAD_M)
    lateral, heading = 100.0 * np.abs(errors.lateral[part]), np.degrees(np.abs(errors.heading[part]))
    return float(lateral.max()), float(lateral.mean()), float(heading.max()), float(heading.mean())


def _arc(centre: tuple[float, float], radius: float, start_deg: float, end_deg: float) -> Array:
    angles = np.radians(np.linspace(start_deg, end_deg, max(3, round(abs(end_deg - start_deg) / 3.0)) + 1))
    return np.stack([centre[0] + radius * np.cos(angles), centre[1] + radius * np.sin(angles)], axis=1)
