"""The records that the compiled loop reads, made of tractor, grounds and plan, and legs joined to paths of guidance.

No code is compiled here: that is vehicle.jit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fields.arrays import Records, measure_along
from vehicle.control.speed_profile import UNLIMITED_MPS, build_driving_limits, limit_by_bends, limit_by_brakes
from vehicle.copying import copy_row
from vehicle.energy.traction import (
    HARD_RESISTANCE,
    SLIP_RESISTANCE,
    compute_best_pull_slip,
    compute_gross_traction,
    compute_net_traction,
    compute_traction_envelope,
)
from vehicle.jit import compile_function
from vehicle.missions.plan import Plan
from vehicle.model.effects import NEUTRAL_FIELDS
from vehicle.model.ground import GROUNDS, Tyres, find_ground_index
from vehicle.model.tractor import Implement, Tractor, get_log_corrections
from vehicle.model.work_load import WorkLoad
from vehicle.records import GATE, GRAVITY_MPS2, GROUND, LEG, STATE, list_record_fields

SAME_M = 1e-6
# A tractor looks at least as far ahead as it drives while its wheels swing by this much: 1.7 s for that of the thesis.
# Measured on paths of 12 kinks of up to 44 degrees at 5 to 15 km/h: with 1.4 times as much, or with less, it weaves.
LOOKAHEAD_SWING_RAD = math.radians(27.2)
WEAVE_SHARE = 0.85  # of the steering rate: what the limits of the thesis's tractor come to at 5 km/h
MODEL = np.dtype(
    [
        *list_record_fields("mass inertia front rear track guide guide_reverse"),
        *list_record_fields("lock dead_band switch rate lag gain latch"),
        *list_record_fields("lateral_gain heading_gain lateral_limit lateral_ease wheel_pace lookahead_s"),
        *list_record_fields("kp ki kd max_drive acceleration shift_time"),
        *list_record_fields("nose tail half_width tool_front tool_tail tool_half_width reach"),
        # Load and terrain (vehicle.sim.load_terms); they count only where `loaded` is 1.
        *list_record_fields("loaded draft_constant draft_linear draft_square axle_power brake_limit"),
        # Traction of the driven wheels (vehicle.energy.traction); a weight of 0 stands for wheels that do not slip.
        *list_record_fields("driven_weight per_driven_weight envelope slip_resistance inverse_mobility"),
        *list_record_fields("best_gain max_slip front_driven"),
        # Effects and terms of a discrepancy model; they count only where `affected` and `discrepancy_model` are 1.
        *((name, "f8") for name in NEUTRAL_FIELDS),
    ]
)
"""The parameters of a tractor as compiled code reads them: one record per kind of tractor, constant during a run.

SI and radians, distances from the centre of mass.
"""


@compile_function
def join_legs(points, sizes, begins, new_run, path, cumulative, ends, first, last) -> int:  # type: ignore[no-untyped-def]
    """Write the joined paths of all missions; returns their number of points.

    `points` (p, 2) are the points of all legs in order, `sizes` (legs,) their numbers; `begins` and `new_run` (legs,)
    mark the legs that begin a mission, and those that begin a run of one gear, within which the lookahead may pass the
    ends of legs. A point that coincides with the one before it is skipped. Within a run a leg continues from the end
    of the leg before, so that distances along the path are those of the joined polyline.

    Written are the first two columns of `path` (p, 3) and `cumulative` (p,), the distance from the start of the
    mission, and per leg in `ends` the distance at its end, in `first` its first segment, and in `last` the last segment
    of its run that has a length.
    """
    size, place, run_start = 0, 0, 0
    mission_m = 0.0
    for leg in range(len(sizes)):
        if begins[leg]:
            mission_m = 0.0
        start, point_count = size, 0
        if new_run[leg]:
            run_start = leg
            x, y = points[place, 0], points[place, 1]
            path[size, 0], path[size, 1], cumulative[size] = x, y, mission_m
            size, point_count = size + 1, 1
        else:
            start = size - 1
            x, y = path[start, 0], path[start, 1]
        leg_m = 0.0
        for place_in in range(place + 1, place + sizes[leg]):
            next_x, next_y = points[place_in, 0], points[place_in, 1]
            step = math.hypot(next_x - x, next_y - y)
            leg_m += step
            if step > SAME_M:
                path[size, 0], path[size, 1], cumulative[size] = next_x, next_y, mission_m + leg_m
                size, point_count = size + 1, point_count + 1
            x, y = next_x, next_y
        if point_count == 0:
            path[size, 0], path[size, 1], cumulative[size] = x, y, mission_m
            size += 1
        place += sizes[leg]
        mission_m += leg_m
        end = size - 2
        first[leg] = start
        while end > first[run_start] and cumulative[end + 1] == cumulative[end]:
            end -= 1
        ends[leg], first[leg] = mission_m, min(start, end)
        last[run_start : leg + 1] = end
    return size


def compute_contact_boxes(tractor: Tractor, implement: Implement) -> dict[str, float]:
    """Contact boxes of tractor and implement, forward of the centre of mass (m)."""
    tool = -(tractor.rear_axle_m + implement.hitch_m)
    return {
        "nose": tractor.length_m - tractor.rear_end_m,
        "tail": -tractor.rear_end_m,
        "half_width": tractor.width_m / 2,
        "tool_front": tool + implement.length_m / 2,
        "tool_tail": tool - implement.length_m / 2,
        "tool_half_width": implement.contact_width_m / 2,
    }


def list_contact_boxes(
    tractor: Tractor, implement: Implement, from_m: float = 0.0
) -> tuple[tuple[float, float, float], ...]:
    """Rear and front end and half the width (m) of both boxes, from a point `from_m` ahead of the centre of mass."""
    ends = compute_contact_boxes(tractor, implement)
    names = ("tail", "nose", "half_width"), ("tool_tail", "tool_front", "tool_half_width")
    return tuple((ends[rear] - from_m, ends[front] - from_m, ends[half]) for rear, front, half in names)


def compute_lateral_ease(tractor: Tractor) -> float:
    """The lateral error times speed (m2/s) up to which guidance corrects without weaving.

    Eq. 2.5 returns to a path at v sqrt(g / wheelbase) rad/s, with g the lateral gain. Wheels that have to swing by more
    than their rate allows at this frequency come late and make the tractor weave, at 12 km/h from errors of 0.7 m on.
    """
    gain = math.radians(tractor.guidance.lateral_gain_deg_per_m)
    if gain == 0.0:
        return math.inf
    rate = math.radians(tractor.steering.rate_deg_per_s)
    return WEAVE_SHARE * rate / (gain * math.sqrt(gain / tractor.wheelbase_m))


def add_implement_mass(tractor: Tractor, load: WorkLoad | None) -> Tractor:
    """The tractor with the mass of its implement, as if that sat where the tractor's own mass does."""
    if load is None or load.implement_mass_kg == 0.0:
        return tractor
    return tractor.model_copy(update={"mass_kg": tractor.mass_kg + load.implement_mass_kg})


def build_load_fields(tractor: Tractor, load: WorkLoad) -> dict[str, float]:
    """Fields of MODEL for a load, of a tractor with the mass of its implement."""
    constant, linear, square = load.draft_n
    fields = {
        "loaded": 1.0, "axle_power": load.axle_power_w, "brake_limit": tractor.speed.max_drive_n,
        "draft_constant": constant, "draft_linear": linear, "draft_square": square,
    }  # fmt: skip
    mobility = load.mobility_number
    if mobility is None:
        return fields
    driven_weight = load.driven_share * tractor.mass_kg * GRAVITY_MPS2
    max_slip = compute_best_pull_slip(mobility, load.max_slip)
    return fields | {
        "driven_weight": driven_weight,
        "per_driven_weight": 1.0 / driven_weight,
        "envelope": compute_traction_envelope(mobility),
        "slip_resistance": SLIP_RESISTANCE / math.sqrt(mobility),
        "inverse_mobility": 1.0 / mobility,
        "best_gain": compute_net_traction(max_slip, mobility) + 1.0 / mobility,
        "max_slip": max_slip,
        "front_driven": float(load.driven_share == 1.0),
        "brake_limit": driven_weight * (compute_gross_traction(load.max_slip, mobility) - HARD_RESISTANCE),
    }


def build_model_record(tractor: Tractor, implement: Implement, load: WorkLoad | None = None) -> Records:
    """One MODEL record."""
    tractor = add_implement_mass(tractor, load)
    model, boxes = np.zeros((), dtype=MODEL), compute_contact_boxes(tractor, implement)
    steering, guidance, speed = tractor.steering, tractor.guidance, tractor.speed
    rate = math.radians(steering.rate_deg_per_s)
    sizes = list_contact_boxes(tractor, implement)
    reach = max(math.hypot(max(abs(rear), abs(front)), half) for rear, front, half in sizes)
    values = {
        "mass": tractor.mass_kg, "inertia": tractor.inertia_kg_m2,
        "front": tractor.front_axle_m, "rear": tractor.rear_axle_m, "track": tractor.track_m,
        "guide": tractor.guide_m, "guide_reverse": -tractor.rear_axle_m,
        "lock": math.radians(tractor.max_steering_deg), "dead_band": math.radians(steering.dead_band_deg),
        "switch": math.radians(steering.switch_deg), "rate": rate,
        "lag": steering.lag_s, "gain": steering.gain, "latch": float(steering.latch),
        "lateral_gain": math.radians(guidance.lateral_gain_deg_per_m), "heading_gain": guidance.heading_gain,
        "lateral_limit": guidance.lateral_limit_m, "lateral_ease": compute_lateral_ease(tractor),
        "wheel_pace": rate * guidance.turn_lookahead_m, "lookahead_s": LOOKAHEAD_SWING_RAD / rate,
        "kp": speed.proportional_n_s_per_m, "ki": speed.integral_n_per_m, "kd": speed.derivative_n_s2_per_m,
        "max_drive": speed.max_drive_n, "acceleration": speed.max_acceleration_mps2, "shift_time": speed.shift_time_s,
        "reach": reach, **boxes,
    }  # fmt: skip
    if load is not None:
        values |= build_load_fields(tractor, load)
    for name, value in (values | get_log_corrections(tractor).fields).items():
        model[name] = value
    return model


def build_ground_records(load: WorkLoad | None = None) -> Records:
    """GROUND records in the order of vehicle.model.ground.GROUNDS; a load may say how much they resist rolling."""
    rows = build_tyre_ground_records(GROUNDS)
    if load is not None and load.rolling_share is not None:
        rows["rolling"] = load.rolling_share
    return rows


def build_tyre_ground_records(tyres: Sequence[Tyres]) -> Records:
    """One GROUND record per set of tyres."""
    rows = np.zeros(len(tyres), dtype=GROUND)
    for row, tyre in zip(rows, tyres, strict=True):
        row["front_slope"] = math.degrees(tyre.front_slope_per_deg)
        row["front_limit"] = math.radians(tyre.front_limit_deg)
        row["rear_slope"] = math.degrees(tyre.rear_slope_per_deg)
        row["rear_limit"] = math.radians(tyre.rear_limit_deg)
        row["rolling"], row["grip"] = tyre.rolling_resistance, tyre.grip or 1e6
        row["shaped"] = float(tyre.curve is not None or tyre.grip is not None)
        if tyre.curve is not None:
            row["peak_slip"], row["peak"] = tyre.curve.peak_slip_rad, tyre.curve.peak
            row["slide_slip"], row["slide"] = tyre.curve.slide_slip_rad, tyre.curve.slide
            row["ease"] = tyre.curve.ease_mps
    return rows


@dataclass(frozen=True)
class CompiledPlan:
    """A plan as arrays: states (n,), legs, gates, path points (p, 3) and the distance along them (p,).

    The third column of the points is the largest speed there (m/s), whatever that of the leg is.
    """

    states: Records
    legs: Records
    gates: Records
    points: Records
    cumulative: Records


def compile_plan(plan: Plan, tractor: Tractor, *, limits_speed: bool = True) -> CompiledPlan:
    """All missions of a plan, one after another in shared arrays. Every tractor is of the same model.

    Without `limits_speed` bends are driven at the speed of the leg, as in the experiments of the thesis.
    """
    states = np.zeros(plan.tractors, dtype=STATE)
    counts = np.array([len(mission.legs) for mission in plan.missions])
    ends = np.cumsum(counts)
    states["leg"] = states["first_leg"] = ends - counts
    states["stand_left"] = [mission.legs[0].standing_s for mission in plan.missions]
    states["last_leg"] = ends - 1
    states["stage"], states["status"] = 1, 3
    states["away"] = [mission.enters for mission in plan.missions]
    states["leaves"] = [mission.leaves for mission in plan.missions]
    for state, mission in zip(states, plan.missions, strict=True):
        # The antenna stands on the first point of the path, also before a leg in reverse, as it does between legs.
        x, y, heading = mission.start
        state["x"], state["y"] = x - tractor.guide_m * math.cos(heading), y - tractor.guide_m * math.sin(heading)
        state["angle"] = heading
    legs = _build_leg_rows(plan, tractor)
    points, cumulative = _fill_joined_paths(plan, legs, states["first_leg"])
    if limits_speed:
        _limit_speeds(points, cumulative, legs, tractor)
    states["segment"] = legs["first_segment"][states["first_leg"]]
    gates = _resolve_leg_references(plan, states, legs)
    return CompiledPlan(states, legs, gates, points, cumulative)


def _build_leg_rows(plan: Plan, tractor: Tractor) -> Records:
    """LEG records of all legs, without paths and links to other legs."""
    guidance = tractor.guidance
    legs = [leg for mission in plan.missions for leg in mission.legs]
    rows = np.zeros(len(legs), dtype=LEG)
    rows["speed"] = [leg.speed_mps for leg in legs]
    rows["lookahead"] = np.where([leg.task.is_work for leg in legs], guidance.lookahead_m, guidance.turn_lookahead_m)
    rows["stand"] = [leg.standing_s for leg in legs]
    rows["gear"] = [leg.gear for leg in legs]
    rows["implement"] = [leg.implement for leg in legs]
    index = {name: find_ground_index(name) for name in {leg.ground for leg in legs}}
    rows["ground"] = [index[leg.ground] for leg in legs]
    rows["leader"], rows["leader_leg"] = -1, -1
    return rows


def _fill_joined_paths(plan: Plan, rows: Records, first_legs: Records) -> tuple[Records, Records]:
    """Points of the joined paths and the distances along them; writes ends and segments to the rows."""
    polylines = [leg.points for mission in plan.missions for leg in mission.legs]
    sizes = np.array([len(points) for points in polylines])
    begins = np.zeros(len(rows), dtype=np.bool_)
    begins[first_legs] = True
    new_run = begins | (rows["gear"] != np.roll(rows["gear"], 1))
    points = np.concatenate(polylines, dtype=np.float64)
    path, along = np.full((len(points), 3), UNLIMITED_MPS), np.empty(len(points))
    written_m, first, last = np.empty(len(rows)), np.empty(len(rows), np.int64), np.empty(len(rows), np.int64)
    size = join_legs(points, sizes, begins, new_run, path, along, written_m, first, last)
    rows["end"], rows["first_segment"], rows["last_segment"] = written_m, first, last
    return path[:size].copy(), along[:size].copy()


def _limit_speeds(path: Records, cumulative: Records, rows: Records, tractor: Tractor) -> None:
    """Write the speed limits of the joined paths."""
    limits = [build_driving_limits(tractor, ground.name) for ground in GROUNDS]
    lateral, length = np.array([one.lateral_mps2 for one in limits]), np.array([one.length_m for one in limits])
    first, last, grounds = (np.ascontiguousarray(rows[name]) for name in ("first_segment", "last_segment", "ground"))
    steering, window, deceleration = limits[0].steering_mps, limits[0].window_m, limits[0].deceleration_mps2
    limit_runs(path, cumulative, first, last, grounds, lateral, length, steering, window, deceleration)


@compile_function
def limit_runs(  # type: ignore[no-untyped-def]
    path, cumulative, first_segments, last_segments, grounds, lateral, length, steering, window, deceleration
) -> None:
    """Write the speed limits of each run of one gear to the third column of `path` (p, 3).

    `first_segments`, `last_segments` and `grounds` (legs,) are of the legs; `lateral` and `length` are per ground.
    """
    leg = 0
    while leg < len(first_segments):
        first, end = first_segments[leg], last_segments[leg] + 2
        count = end - first
        lateral_at, length_at, limits = np.empty(count), np.empty(count), np.empty(count)
        last = leg
        while last < len(first_segments) and last_segments[last] + 2 == end:
            begin = first_segments[last] - first
            lateral_at[begin:], length_at[begin:] = lateral[grounds[last]], length[grounds[last]]
            last += 1
        limit_by_bends(path[first:end], cumulative[first:end], lateral_at, length_at, steering, window, limits)
        limit_by_brakes(cumulative[first:end], deceleration, limits)
        copy_row(limits, path[first:end, 2])
        leg = last


def compute_point_speeds(plan: Plan, tractor: Tractor) -> list[list[list[float]]]:
    """The largest speed (m/s, down to 1 mm/s) at every point of every leg of every tractor: that of the leg or less."""
    program = compile_plan(plan, tractor)
    speeds, number = [], 0
    for mission in plan.missions:
        mission_speeds = []
        for leg in mission.legs:
            row = program.legs[number]
            run = slice(row["first_segment"], row["last_segment"] + 2)
            along_m = row["end"] - leg.length_m + measure_along(leg.points)
            limits = np.interp(along_m, program.cumulative[run], program.points[run, 2])
            mission_speeds.append((np.floor(1e3 * np.minimum(limits, leg.speed_mps)) / 1e3).tolist())
            number += 1
        speeds.append(mission_speeds)
    return speeds


def _resolve_leg_references(plan: Plan, states: Records, legs: Records) -> Records:
    """Resolve gates and follow orders to absolute legs and progress; returns the gate rows."""
    first_legs, ends = states["first_leg"].tolist(), legs["end"].tolist()
    gates: list[tuple[int, float]] = []
    counts = []
    for index, leg in enumerate(leg for mission in plan.missions for leg in mission.legs):
        counts.append(len(leg.gates))
        for gate in leg.gates:
            leg_start_m = ends[first_legs[gate.tractor] + gate.leg - 1] if gate.leg else 0.0
            gates.append((gate.tractor, gate.compute_opening_m(leg_start_m, plan.missions[gate.tractor].legs)))
        if leg.follow:
            row = legs[index]
            row["leader"], row["gap"] = leg.follow.tractor, leg.follow.gap_m
            row["leader_leg"] = first_legs[leg.follow.tractor] + leg.follow.leg
    legs["last_gate"] = np.cumsum(counts)
    legs["first_gate"] = legs["last_gate"] - counts
    return np.array(gates, dtype=GATE) if gates else np.zeros(0, dtype=GATE)
