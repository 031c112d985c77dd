"""How the driven turn differs from the planned one, for the tractor that plans by default.

    python -m tests.benchmarks.turns

Planned length and depth are the closed forms; driven are the antenna's path from the end of one track to the start of
the next, its depth beyond the track end, its largest distance from the planned path, and how far beside the next track
it is where the implement is lowered.
"""

from __future__ import annotations

import math

import numpy as np
import shapely

from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from strategies.path_planning.paths import DrivePath, Pose
from strategies.path_planning.turns import build_fishtail, build_omega_turn, build_switch_back, build_u_turn
from strategies.program.turn_timing import TurnTimer
from vehicle.missions.plan import Plan
from vehicle.sim.world import simulate

UP, DOWN = math.pi / 2, -math.pi / 2


def driven(clock: TurnTimer, path: DrivePath, tool_m: float) -> tuple[float, float, float, float]:
    """Driven length, depth, largest deviation and lateral error at lowering (m)."""
    mission = clock.build_mission(path)
    run = simulate(Plan((mission,)), clock.tractor, clock.implement)
    legs, xy = run.record[:, 0, 5], run.record[:, 0, :2]
    line = shapely.LineString(np.concatenate([leg.points for leg in mission.legs]))
    turning = (legs > 0) & (legs < legs.max())
    after = legs == legs.max()
    lowered = np.argmax(xy[after, 1] < path.end[1] - tool_m)
    return (
        float(np.hypot(*np.diff(xy[turning], axis=0).T).sum()),
        float(xy[:, 1].max()),
        float(shapely.distance(shapely.points(xy), line).max()),
        float(abs(xy[after][lowered, 0] - path.end[0])),
    )


def main() -> None:
    """Print one line per kind of turn."""
    site = prepare_context(WorkOrder(PlanRequest(field="iwamizawa")))
    clock = TurnTimer(site.tractor, site.implement, site.driving_rules, "soil")
    radius = site.driving_rules.radius_m
    print(f"turning radius {radius:.2f} m, {site.driving_rules.turn_speed_mps * 3.6:.1f} km/h")
    print(f"{'turn':22}{'planned':>9}{'driven':>8}{'depth':>7}{'driven':>8}{'apart':>7}{'aside':>7}{'time':>7}")
    a: Pose = (0.0, 0.0, UP)
    for name, make, spacing in (
        ("u, 9 m", build_u_turn, 9.0),
        ("omega, 3 m", build_omega_turn, 3.0),
        ("switch-back, 3 m", build_switch_back, 3.0),
        ("fishtail, 3 m", build_fishtail, 3.0),
    ):
        path = make(a, (spacing, 0.0, DOWN), radius)
        assert path is not None
        length, depth, apart, aside = driven(clock, path, site.driving_rules.tool_m)
        planned_depth = max(float(points[:, 1].max()) for _, points in path.sample(0.05))
        print(
            f"{name:22}{path.length_m:9.2f}{length:8.2f}{planned_depth:7.2f}{depth:8.2f}{apart:7.2f}{aside:7.2f}"
            f"{clock.measure_seconds(path):7.1f}"
        )


if __name__ == "__main__":
    main()
