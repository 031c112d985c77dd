"""A pymunk space with tractors that execute a plan, by the compiled loop or by a slow one in plain Python.

The slow loop uses pymunk's ordinary API. Tests compare the compiled loop with it, and it runs where pymunk's batch
layout is unknown. Both call the same formulas; reading, forces, stepping and contacts are implemented separately.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pymunk

from fields.arrays import Records
from vehicle.control.guidance import run_control_tick
from vehicle.errors import VehicleError
from vehicle.missions.plan import Plan, check_plan
from vehicle.missions.run import CONFLICT, DONE, STALL, TIMEOUT, Conflict, RollOverMargin, SimulationRun, Stall
from vehicle.model.gnss import NO_ERROR, draw_error, make_error_keys
from vehicle.model.terrain import NO_TERRAIN, Terrain, compute_gradient
from vehicle.model.tractor import Implement, Tractor
from vehicle.model.work_load import WorkLoad
from vehicle.records import DT_S, RECORD_COLUMNS
from vehicle.sim.calibration import build_steering_tables
from vehicle.sim.clearance import build_start_distances, find_too_close
from vehicle.sim.compile import add_implement_mass, build_ground_records, build_model_record, compile_plan
from vehicle.sim.load_terms import STALL_AFTER_S, build_roll_over_margins, build_stall
from vehicle.sim.loop import (
    ALL_DONE,
    IGNORE_CLEARANCE_M,
    MIN_PROGRESS_M,
    NEIGHBOURS_CHANGED,
    RUNNING,
    STALLED,
    TOO_CLOSE,
    drive_tractor,
    run_loop,
    write_record_row,
)
from vehicle.sim.pymunk_bridge import (
    ContactBoxes,
    EngineUnavailableError,
    PymunkEngine,
    create_body,
    create_space,
    drop_false_contact,
)

CHUNK_S = 600.0  # of simulated time between two calls of `progress`
# Expected time of a run over that of its speeds, for which memory is reserved.
EXPECTED_TIME_FACTOR, EXPECTED_TIME_MARGIN_S = 1.1, 60.0
GROWTH_FACTOR = 1.5  # of the record where that is not enough
STALL_S = 120.0  # without progress of any tractor: far longer than a change of gear


def _check_heights(terrain: Terrain, points: Records) -> None:
    """Raise VehicleError if a path leads beyond the known heights, where the ground would only seem level."""
    if terrain.covers(points[:, :2], terrain.spacing_m):
        return
    west, south, east, north = terrain.bounds_m
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    raise VehicleError(
        f"Paths reach from ({low[0]:.0f}, {low[1]:.0f}) to ({high[0]:.0f}, {high[1]:.0f}) m, but heights go from "
        f"({west:.0f}, {south:.0f}) to ({east:.0f}, {north:.0f}) m; keep the paths there, for "
        "instance with less overhang, or plan without heights.",
        parameter="elevation",
    )


def run_slow_loop(
    world: World, steps: int, dt: float, record: Records, stop: tuple[float, float], stall_s: float
) -> tuple[int, int, int, int]:
    """As vehicle.sim.loop.run_loop, for a world; returns outcome, record rows and the closest pair."""
    program, states = world.program, world.program.states.view(np.recarray)
    models, grounds = world.models.view(np.recarray), world.grounds.view(np.recarray)
    legs, gates = program.legs.view(np.recarray), program.gates.view(np.recarray)
    _record_contacts(world, dt)
    rows = 0
    for _ in range(steps):
        step = int(world.clock[0])
        time = step * dt
        if step % world.steps_per_tick == 0:
            for state, body in zip(program.states, world.bodies, strict=True):
                (state["x"], state["y"]), state["angle"] = body.position, body.angle
            if len(world.position_errors):
                for state in states:
                    draw_error(state, world.position_errors)
            for tractor in range(len(states)):
                path, period = (program.points, program.cumulative), world.steps_per_tick * dt
                run_control_tick(tractor, states, models, legs, gates, *path, time, period)
            world.boxes.required[:] = (states["away"] == 0) & (stop[0] > IGNORE_CLEARANCE_M)
            world.boxes.update_space()
            write_record_row(record, rows, states)
            rows += 1
            outcome, pair = _judge_outcome(world, time, stop, stall_s)
            if outcome != RUNNING:
                return outcome, rows, *pair
        for index, body in enumerate(world.bodies):
            ground = int(legs[states[index].leg].ground)
            pose = np.array([*body.position, body.angle, *body.velocity, body.angular_velocity])
            if len(world.heights):
                slopes = compute_gradient(world.heights, world.frame, *(body.position + dt * body.velocity))
                states[index].slope_east, states[index].slope_north = slopes
            push = np.zeros(3)
            model = int(states[index].model)
            drive_tractor(states[index], models[model], grounds, ground, world.tables[model, ground], pose, push, dt)
            body.force, body.torque = (push[0], push[1]), push[2]
        world.space.step(dt)
        world.clock[0] += 1.0
    return RUNNING, rows, -1, -1


def _judge_outcome(world: World, time: float, stop: tuple[float, float], stall_s: float) -> tuple[int, tuple[int, int]]:
    states, clock = world.program.states, world.clock
    if len(states) > 1 and stop[0] > IGNORE_CLEARANCE_M:
        _, first, second = find_too_close(states, world.models, world.clearances, world.start_distances, *stop)
        if first >= 0:
            return TOO_CLOSE, (first, second)
    stuck = np.flatnonzero(states["short_time"] > STALL_AFTER_S)
    if len(stuck):
        return STALLED, (int(stuck[0]), -1)
    if (states["done"] == 1).all():
        return ALL_DONE, (-1, -1)
    total = float(states["progress"].sum())
    standing = ((states["stand_left"] > 0.0) & (states["started"] == 1)).any()
    if total > clock[1] + MIN_PROGRESS_M or standing:
        clock[1], clock[2] = total, time
    elif time - clock[2] > stall_s:
        return STALLED, (-1, -1)
    return RUNNING, (-1, -1)


def _record_contacts(world: World, dt: float) -> None:
    """Record every contact in the table that the compiled loop uses."""

    def record_contact(arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:
        drop_false_contact(arbiter, space, data)
        used = int(world.contacts[-1, 0])
        if arbiter.process_collision and used < len(world.contacts) - 1:
            first, second = (shape.body.id for shape in arbiter.shapes if shape.body)
            world.contacts[used] = world.clock[0] * dt, first, second
            world.contacts[-1, 0] += 1.0

    world.space.on_collision(None, None, begin=record_contact)


@dataclass(frozen=True, eq=False)
class WorldSnapshot:
    """A world in the middle of a run without contacts: all that is needed to continue bit for bit.

    `motion` (n, 6) are x, y, angle, velocity and spin of the bodies, the first `rows` of `chunks` are the record so
    far. Legs and segments in `states` are counted from the first of each tractor, so that another plan may have other
    legs after them.
    """

    clock: Records
    states: Records
    clearances: Records
    start_distances: Records
    motion: Records
    boxes_present: Records
    chunks: Sequence[Records]
    rows: int

    @property
    def time_s(self) -> float:
        """Simulated time of the snapshot."""
        return float(self.clock[0] * DT_S)

    @property
    def step(self) -> int:
        """Number of steps before the snapshot."""
        return int(self.clock[0])

    def attach_to_record(self, record: Records) -> WorldSnapshot:
        """The same, with its rows as a view of the record of the whole run, so that they are stored once."""
        return replace(self, chunks=(record[: self.rows],))

    def list_record_parts(self) -> list[Records]:
        """The record so far, in parts; there may be more in `chunks`."""
        parts, remaining_rows = [], self.rows
        for chunk in self.chunks:
            parts.append(chunk[:remaining_rows])
            remaining_rows -= len(parts[-1])
            if not remaining_rows:
                break
        return parts


class World:
    """Executes one plan. Every tractor is of the same kind and carries the same implement.

    `position_errors` is a GNSS table of vehicle.model.gnss, from which each tractor draws its own errors by the `seed`.
    Without `terrain` the ground is level, without `load` nothing is pulled and power and grip are not limited.
    """

    def __init__(
        self,
        plan: Plan,
        tractor: Tractor,
        implement: Implement,
        *,
        terrain: Terrain | None = None,
        load: WorkLoad | None = None,
        position_errors: Records | None = None,
        seed: int = 1,
    ) -> None:
        check_plan(plan)
        self.plan, self.tractor, self.terrain = plan, tractor, terrain
        self.load = WorkLoad() if terrain is not None and load is None else load
        self.program = compile_plan(plan, tractor)
        if terrain is not None:
            _check_heights(terrain, self.program.points)
        self.heights, self.frame = (NO_TERRAIN, np.zeros(3)) if terrain is None else (terrain.grid, terrain.frame)
        self.models = np.array([build_model_record(tractor, implement, self.load)])
        self.grounds = build_ground_records(self.load)
        self.tables = build_steering_tables(tractor)[None]
        self.position_errors = NO_ERROR if position_errors is None else position_errors
        self.program.states["error_key"] = make_error_keys(seed, plan.tractors)
        self.steps_per_tick = tractor.guidance.count_steps(DT_S)
        self.space = create_space()
        poses = [(float(s["x"]), float(s["y"]), float(s["angle"])) for s in self.program.states]
        loaded_tractor = add_implement_mass(tractor, self.load)
        self.bodies = [create_body(self.space, loaded_tractor, pose) for pose in poses]
        self.boxes = ContactBoxes(self.space, self.bodies, tractor, implement)
        self.clock = np.zeros(3)
        self.clearances = np.full(plan.tractors, np.inf)
        self.start_distances = build_start_distances([mission.enters for mission in plan.missions])
        self.contacts = np.zeros((256, 3))
        self.pair = (-1, -1)
        self.rows = 0
        self._record: Records = np.empty((0, plan.tractors, len(RECORD_COLUMNS)))
        self.outcome = RUNNING

    def run(
        self,
        *,
        stop_clearance_m: float = -1.0,
        beside_clearance_m: float | None = None,
        max_time_s: float = 4 * 86400.0,
        progress: Callable[[float], None] | None = None,
        slow: bool = False,
        independent: bool = False,
        chunk_s: float = CHUNK_S,
    ) -> SimulationRun:
        """Simulate until every tractor is done, two come closer than `stop_clearance_m`, or nothing moves any more.

        Two that are beside each other on parallel lines (vehicle.sim.clearance) may come as close as
        `beside_clearance_m`, and two that begin nearer may drive apart. `progress` is called with the driven share of
        all path length, every `chunk_s` of simulated time. `slow` selects the plain Python loop. `independent`
        tractors drive through each other, and no clearance is measured.
        """
        advance = self._choose_loop(slow)
        stop_clearance_m = IGNORE_CLEARANCE_M if independent else stop_clearance_m
        stop = stop_clearance_m, stop_clearance_m if beside_clearance_m is None else beside_clearance_m
        most = math.ceil(max_time_s / DT_S)
        expected_s = min(self._expected_s, max_time_s)
        outcome = RUNNING
        total = float(sum(self.program.legs["end"][s["last_leg"]] for s in self.program.states))
        while outcome == RUNNING and self.clock[0] < most:
            steps = min(round(chunk_s / DT_S), most - int(self.clock[0]))
            chunk = self._reserve_rows(math.ceil(steps / self.steps_per_tick) + 1, expected_s)
            outcome, rows, *self.pair = advance(steps, chunk, stop)
            self.outcome = outcome
            self.rows += rows
            if progress:
                progress(min(1.0, float(self.program.states["progress"].sum()) / total))
        return self._build_run(outcome, self._record[: self.rows])

    def take_snapshot(self) -> WorldSnapshot | None:
        """The world between two steps; None if the run has ended or tractors have touched, which pymunk remembers."""
        if self.outcome != RUNNING or self.contacts[-1, 0] > 0:
            return None
        motion = [(*body.position, body.angle, *body.velocity, body.angular_velocity) for body in self.bodies]
        states, (legs, segments) = self.program.states.copy(), self._list_first_legs_and_segments()
        states["leg"] -= legs
        states["segment"] -= segments
        distances = self.clearances.copy(), self.start_distances.copy()
        present = self.boxes.present.copy()
        return WorldSnapshot(
            self.clock.copy(), states, *distances, np.array(motion), present, (self._record,), self.rows
        )

    def restore(self, snapshot: WorldSnapshot) -> None:
        """Continue from a snapshot of a world whose plan was the same as far as tractors had driven and looked ahead.

        Later legs may differ, also in number.
        """
        states, own = snapshot.states.copy(), self.program.states
        legs, segments = self._list_first_legs_and_segments()
        states["leg"] += legs
        states["segment"] += segments
        for name in ("first_leg", "last_leg", "leaves"):
            states[name] = own[name]
        self.clock[:], own[:] = snapshot.clock, states
        self.clearances[:], self.start_distances[:] = snapshot.clearances, snapshot.start_distances
        self.boxes.required[:] = snapshot.boxes_present
        for body, (x, y, angle, vx, vy, spin) in zip(self.bodies, snapshot.motion.tolist(), strict=True):
            body.position, body.angle, body.velocity, body.angular_velocity = (x, y), angle, (vx, vy), spin
        self.boxes.update_space()
        self.rows, self._record = 0, np.empty((0, *self._record.shape[1:]))
        for part in snapshot.list_record_parts():
            self._reserve_rows(len(part), self._expected_s)[:] = part
            self.rows += len(part)

    def _reserve_rows(self, rows: int, expected_s: float = 0.0) -> Records:
        """Room for `rows` more rows after those of the record.

        The expected length of the run is reserved at once: memory that is not written to costs nothing.
        """
        if self.rows + rows > len(self._record):
            expected = math.ceil(expected_s / (DT_S * self.steps_per_tick)) + 1
            count = max(self.rows + rows, expected, math.ceil(GROWTH_FACTOR * len(self._record)))
            wider = np.empty((count, *self._record.shape[1:]))
            wider[: self.rows] = self._record[: self.rows]
            self._record = wider
        return self._record[self.rows : self.rows + rows]

    @property
    def _expected_s(self) -> float:
        """About how long the plan takes if hardly any tractor waits."""
        mission_times_s = (
            math.fsum(leg.standing_s + leg.length_m / leg.speed_mps for leg in mission.legs)
            for mission in self.plan.missions
        )
        return EXPECTED_TIME_FACTOR * max(mission_times_s) + EXPECTED_TIME_MARGIN_S

    @property
    def leg_ends_m(self) -> list[Records]:
        """Where the legs of each tractor end, counted from its start."""
        first, ends = self.program.states["first_leg"], self.program.legs["end"]
        return np.split(ends, first[1:])

    def _list_first_legs_and_segments(self) -> tuple[Records, Records]:
        """The first leg and the first segment of each tractor (n,) in the arrays of the program."""
        legs = self.program.states["first_leg"].copy()
        return legs, self.program.legs["first_segment"][legs]

    def _choose_loop(self, slow: bool) -> Callable[[int, Records, tuple[float, float]], Any]:
        if not slow:
            try:
                engine = PymunkEngine(self.space, self.bodies)
            except EngineUnavailableError as error:
                warnings.warn(f"{error} Simulating in plain Python, about 100 times slower.", stacklevel=3)
            else:
                return lambda steps, record, stop: self._run_compiled_loop(engine, steps, record, stop)
        return lambda steps, record, stop: run_slow_loop(self, steps, DT_S, record, stop, STALL_S)

    def _run_compiled_loop(self, engine: PymunkEngine, steps: int, record: Records, stop: tuple[float, float]) -> Any:
        """Run the compiled loop for `steps` steps, with contact boxes in the space where tractors are near others."""
        program, last, rows = self.program, int(self.clock[0]) + steps, 0
        while True:
            outcome, more, first, second = run_loop(
                last - int(self.clock[0]), DT_S, self.steps_per_tick, self.clock, engine.bridge,
                program.states, self.models, self.grounds, self.tables, program.legs, program.gates,
                program.points, program.cumulative, record[rows:], self.clearances, self.start_distances,
                self.contacts, *stop, STALL_S, self.position_errors, self.boxes.present, self.boxes.required,
                self.heights, self.frame,
            )  # fmt: skip
            rows += more
            if outcome != NEIGHBOURS_CHANGED:
                return outcome, rows, first, second
            self.boxes.update_space()

    def _build_run(self, outcome: int, record: Records) -> SimulationRun:
        names = {ALL_DONE: DONE, TOO_CLOSE: CONFLICT, STALLED: STALL, RUNNING: TIMEOUT}
        states = self.program.states
        return SimulationRun(
            plan=self.plan,
            outcome=names[outcome],
            time_s=np.arange(len(record), dtype=np.float64) * (DT_S * self.steps_per_tick),
            record=record,
            finish_s=np.where(states["done"] == 1, states["done_time"], np.nan),
            contacts=self._list_first_contacts(),
            min_clearance_m=float(self.clearances.min()),
            conflict=self._build_conflict() if outcome == TOO_CLOSE else None,
            stall=self._build_stall(self.pair[0]) if outcome == STALLED and self.pair[0] >= 0 else None,
            roll_over=self._list_roll_over_margins(),
        )

    def _build_conflict(self) -> Conflict:
        states, pair = self.program.states, self.pair
        legs = [int(states["leg"][i] - states["first_leg"][i]) for i in pair]
        ends = self.program.legs["end"]
        starts = [float(ends[states["leg"][i] - 1]) if leg else 0.0 for i, leg in zip(pair, legs, strict=True)]
        done = [float(states["progress"][i]) - start for i, start in zip(pair, starts, strict=True)]
        return Conflict(float(self.clock[0] * DT_S), int(pair[0]), int(pair[1]), *legs, *done)

    def _build_stall(self, tractor: int) -> Stall:
        state = self.program.states[tractor]
        ground = self.grounds[self.program.legs[state["leg"]]["ground"]]
        return build_stall(tractor, float(self.clock[0] * DT_S), state, self.models[state["model"]], ground)

    def _list_roll_over_margins(self) -> tuple[RollOverMargin, ...]:
        height_m = None if self.load is None else self.load.centre_height_m
        if self.load is not None and height_m is None and self.tractor.stability is not None:
            height_m = self.tractor.stability.centre_height_m
        return () if height_m is None else build_roll_over_margins(self.program.states, self.tractor.track_m, height_m)

    def _list_first_contacts(self) -> tuple[tuple[float, int, int], ...]:
        """Each touching pair once, at the time it first touched."""
        number = {body.id: index for index, body in enumerate(self.bodies)}
        seen: dict[tuple[int, int], float] = {}
        for time, a, b in self.contacts[: int(self.contacts[-1, 0])]:
            pair = sorted((number[int(a)], number[int(b)]))
            seen.setdefault((pair[0], pair[1]), float(time))
        return tuple((time, *pair) for pair, time in seen.items())


def simulate(
    plan: Plan,
    tractor: Tractor,
    implement: Implement,
    *,
    terrain: Terrain | None = None,
    load: WorkLoad | None = None,
    **options: Any,
) -> SimulationRun:
    """Build a world for the plan, on terrain and with a load as for World, and run it; options as for World.run."""
    return World(plan, tractor, implement, terrain=terrain, load=load).run(**options)
