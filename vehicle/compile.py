"""Turn frozen parameters and a plan into the arrays of vehicle.layout."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.ground import GROUNDS, ground_index
from vehicle.layout import GATE, GROUND, LEG, MODEL, STATE
from vehicle.learnt import learnt
from vehicle.missions import Leg, Mission, Plan
from vehicle.tractor import Implement, Tractor

Array = npt.NDArray[Any]
SAME_M = 1e-6


def outline(tractor: Tractor, implement: Implement) -> dict[str, float]:
    """Contact boxes of tractor and implement, forward of the centre of mass (m)."""
    tool = -(tractor.rear_axle_m + implement.hitch_m)
    boxes = {
        "nose": tractor.length_m - tractor.rear_end_m,
        "tail": -tractor.rear_end_m,
        "half_width": tractor.width_m / 2,
        "tool_front": tool + implement.length_m / 2,
        "tool_tail": tool - implement.length_m / 2,
        "tool_half_width": implement.contact_width_m / 2,
    }
    return boxes


def compile_model(tractor: Tractor, implement: Implement) -> Array:
    """One MODEL record."""
    model = np.zeros((), dtype=MODEL)
    boxes = outline(tractor, implement)
    values = {
        "mass": tractor.mass_kg,
        "inertia": tractor.inertia_kg_m2,
        "front": tractor.front_axle_m,
        "rear": tractor.rear_axle_m,
        "track": tractor.track_m,
        "guide": tractor.antenna_forward_m - tractor.rear_axle_m,
        "guide_reverse": -tractor.rear_axle_m,
        "lock": math.radians(tractor.max_steering_deg),
        "dead_band": math.radians(tractor.steering.dead_band_deg),
        "switch": math.radians(tractor.steering.switch_deg),
        "rate": math.radians(tractor.steering.rate_deg_per_s),
        "lag": tractor.steering.lag_s,
        "gain": tractor.steering.gain,
        "latch": float(tractor.steering.latch),
        "lateral_gain": math.radians(tractor.guidance.lateral_gain_deg_per_m),
        "heading_gain": tractor.guidance.heading_gain,
        "lateral_limit": tractor.guidance.lateral_limit_m,
        "kp": tractor.speed.proportional_n_s_per_m,
        "ki": tractor.speed.integral_n_per_m,
        "kd": tractor.speed.derivative_n_s2_per_m,
        "max_drive": tractor.speed.max_drive_n,
        "acceleration": tractor.speed.max_acceleration_mps2,
        "shift_time": tractor.speed.shift_time_s,
        "reach": max(
            math.hypot(max(abs(boxes["nose"]), abs(boxes["tail"])), boxes["half_width"]),
            math.hypot(max(abs(boxes["tool_front"]), abs(boxes["tool_tail"])), boxes["tool_half_width"]),
        ),
        **boxes,
    }
    for name, value in (values | learnt(tractor).fields).items():
        model[name] = value
    return model


def compile_grounds() -> Array:
    """GROUND records in the order of vehicle.ground.GROUNDS."""
    rows = np.zeros(len(GROUNDS), dtype=GROUND)
    for row, ground in zip(rows, GROUNDS, strict=True):
        row["front_slope"] = math.degrees(ground.front_slope_per_deg)
        row["front_limit"] = math.radians(ground.front_limit_deg)
        row["rear_slope"] = math.degrees(ground.rear_slope_per_deg)
        row["rear_limit"] = math.radians(ground.rear_limit_deg)
        row["rolling"] = ground.rolling_resistance
    return rows


@dataclass(frozen=True)
class CompiledPlan:
    """A plan as arrays: states (n,), legs, gates, path points (p, 2) and the distance along them (p,)."""

    states: Array
    legs: Array
    gates: Array
    points: Array
    cumulative: Array


def compile_plan(plan: Plan, tractor: Tractor) -> CompiledPlan:
    """All missions of a plan, one after another in shared arrays. Every tractor is of the same model."""
    states = np.zeros(plan.tractors, dtype=STATE)
    legs = np.zeros(sum(len(mission.legs) for mission in plan.missions), dtype=LEG)
    points: list[Array] = []
    cumulative: list[Array] = []
    first_leg = first_point = 0
    for state, mission in zip(states, plan.missions, strict=True):
        path, along = _lay_path(mission, legs[first_leg : first_leg + len(mission.legs)], first_point)
        for row, leg in zip(legs[first_leg:], mission.legs, strict=False):
            _fill_leg(row, leg, tractor)
        state["x"], state["y"], state["angle"] = _body_start(mission, tractor)
        state["leg"] = state["first_leg"] = first_leg
        state["last_leg"] = first_leg + len(mission.legs) - 1
        state["segment"] = first_point
        state["stage"], state["status"] = 1, 3
        points.append(path)
        cumulative.append(along)
        first_leg += len(mission.legs)
        first_point += len(path)
    gates = _link(plan, states, legs)
    return CompiledPlan(states, legs, gates, np.concatenate(points), np.concatenate(cumulative))


def _body_start(mission: Mission, tractor: Tractor) -> tuple[float, float, float]:
    """Pose of the centre of mass so that the guided point stands on the first path point."""
    x, y, heading = mission.start
    forward = mission.legs[0].gear > 0
    reach = (tractor.antenna_forward_m if forward else 0.0) - tractor.rear_axle_m
    return x - reach * math.cos(heading), y - reach * math.sin(heading), heading


def _lay_path(mission: Mission, rows: Array, offset: int) -> tuple[Array, Array]:
    """Join the polylines of a mission; legs of one gear form a run in which the lookahead may pass leg ends.

    Within a run a leg continues from where the one before ended, so that the distance along the path is that of the
    joined polyline.
    """
    path: list[Array] = []
    along: list[Array] = []
    done, size, run_start = 0.0, 0, 0
    for index, leg in enumerate(mission.legs):
        new_run = index == 0 or leg.gear != mission.legs[index - 1].gear
        points = leg.points if new_run else np.concatenate([path[-1][-1:], leg.points[1:]])
        step = np.hypot(*np.diff(points, axis=0).T)
        keep = np.concatenate(([new_run], step > SAME_M))
        distance = done + np.concatenate(([0.0], np.cumsum(step)))
        path.append(points[keep] if keep.any() else points[:1])
        along.append(distance[keep] if keep.any() else distance[:1])
        if new_run:
            run_start = index
        rows[index]["first_segment"] = offset + (size if new_run else size - 1)
        size += len(path[-1])
        done = float(distance[-1])
        rows[index]["end"] = done
        for row in rows[run_start : index + 1]:
            row["last_segment"] = offset + size - 2
    return np.concatenate(path), np.concatenate(along)


def _fill_leg(row: Any, leg: Leg, tractor: Tractor) -> None:
    guidance = tractor.guidance
    row["speed"] = leg.speed_mps
    row["lookahead"] = guidance.lookahead_m if leg.task.works else guidance.turn_lookahead_m
    row["gear"], row["implement"], row["ground"] = leg.gear, int(leg.implement), ground_index(leg.ground)


def _link(plan: Plan, states: Array, legs: Array) -> Array:
    """Resolve gates and follow orders to absolute legs and progress; returns the gate rows."""
    rows: list[tuple[int, float]] = []
    for state, mission in zip(states, plan.missions, strict=True):
        for index, leg in enumerate(mission.legs):
            row = legs[int(state["first_leg"]) + index]
            row["first_gate"] = len(rows)
            for gate in leg.gates:
                target = int(states[gate.tractor]["first_leg"]) + gate.leg
                before = legs[target - 1]["end"] if gate.leg else 0.0
                rows.append((gate.tractor, float(before) + gate.after_m))
            row["last_gate"] = len(rows)
            row["leader"], row["leader_leg"] = -1, -1
            if leg.follow:
                row["leader"], row["gap"] = leg.follow.tractor, leg.follow.gap_m
                row["leader_leg"] = int(states[leg.follow.tractor]["first_leg"]) + leg.follow.leg
    return np.array(rows, dtype=GATE) if rows else np.zeros(0, dtype=GATE)
