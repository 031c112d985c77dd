"""A pymunk space with tractors in it, and the two ways to drive them: by a plan, or by a fixed command."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pymunk

from vehicle.calibration import BASE_LOCK_DEG, CIRCLE_SPEED_MPS, identity_table, steering_tables
from vehicle.compile import CompiledPlan, compile_grounds, compile_model, compile_plan, outline
from vehicle.engine import Engine, EngineUnavailable
from vehicle.gnss import NO_ERROR, error_keys
from vehicle.ground import GROUNDS, ground_index
from vehicle.layout import STATE
from vehicle.loop import ALL_DONE, RUNNING, STALLED, TOO_CLOSE, run_fixed, run_loop
from vehicle.missions import Plan, check_plan
from vehicle.run import CONFLICT, DONE, STALL, TIMEOUT, Conflict, Run
from vehicle.tractor import Implement, Tractor

DT_S = 1.0 / 60.0
CHUNK_S = 600.0
STALL_S = 120.0
Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Circle:
    """A drive with a fixed steering angle: the antenna's track (t, 2), its radius and centre."""

    track: npt.NDArray[np.float64]
    radius_m: float


def make_body(
    space: pymunk.Space, tractor: Tractor, implement: Implement, pose: tuple[float, float, float]
) -> pymunk.Body:
    """A tractor body at its centre of mass, with contact boxes for tractor and implement."""
    body = pymunk.Body(tractor.mass_kg, tractor.inertia_kg_m2)
    body.position, body.angle = pose[:2], pose[2]
    boxes = outline(tractor, implement)
    shapes = [
        _box(body, boxes["tail"], boxes["nose"], boxes["half_width"]),
        _box(body, boxes["tool_tail"], boxes["tool_front"], boxes["tool_half_width"]),
    ]
    space.add(body, *shapes)
    return body


def _box(body: pymunk.Body, rear: float, front: float, half: float) -> pymunk.Poly:
    shape = pymunk.Poly(body, [(rear, -half), (front, -half), (front, half), (rear, half)])
    shape.friction = 0.5
    return shape


class World:
    """Executes one plan. Every tractor is of the same kind and carries the same implement.

    `fixes` is a GNSS table of vehicle.gnss, from which each tractor draws errors of its own by the `seed`.
    """

    def __init__(
        self, plan: Plan, tractor: Tractor, implement: Implement, *, tables: Array | None = None,
        fixes: Array | None = None, seed: int = 1,
    ) -> None:  # fmt: skip
        check_plan(plan)
        self.plan = plan
        self.program: CompiledPlan = compile_plan(plan, tractor)
        self.models = np.array([compile_model(tractor, implement)])
        self.grounds = compile_grounds()
        self.tables = (steering_tables(tractor) if tables is None else tables)[None]
        self.fixes = NO_ERROR if fixes is None else fixes
        self.program.states["error_key"] = error_keys(seed, plan.tractors)
        self.every = max(1, round(1.0 / (tractor.guidance.rate_hz * DT_S)))
        self.space = pymunk.Space()
        poses = [(float(s["x"]), float(s["y"]), float(s["angle"])) for s in self.program.states]
        self.bodies = [make_body(self.space, tractor, implement, pose) for pose in poses]
        self.clock = np.zeros(3)
        self.clearances = np.full(plan.tractors, np.inf)
        self.contacts = np.zeros((256, 3))
        self.pair = (-1, -1)

    def run(
        self,
        *,
        stop_clearance_m: float = -1.0,
        max_time_s: float = 4 * 86400.0,
        progress: Callable[[float], None] | None = None,
        slow: bool = False,
    ) -> Run:
        """Simulate until every tractor is done, two come closer than `stop_clearance_m`, or nothing moves any more.

        `progress` is called with the share of all path length driven. `slow` takes the plain Python loop.
        """
        advance = self._chooser(slow)
        most = math.ceil(max_time_s / DT_S)
        chunks: list[Array] = []
        outcome = RUNNING
        total = float(sum(self.program.legs["end"][s["last_leg"]] for s in self.program.states))
        while outcome == RUNNING and self.clock[0] < most:
            chunk = np.empty((math.ceil(CHUNK_S / (DT_S * self.every)) + 1, self.plan.tractors, 7))
            steps = min(round(CHUNK_S / DT_S), most - int(self.clock[0]))
            outcome, rows, *self.pair = advance(steps, chunk, stop_clearance_m)
            chunks.append(chunk[:rows])
            if progress:
                progress(min(1.0, float(self.program.states["progress"].sum()) / total))
        return self._result(outcome, np.concatenate(chunks))

    def _chooser(self, slow: bool) -> Callable[[int, Array, float], Any]:
        program = self.program
        if not slow:
            try:
                engine = Engine(self.space, self.bodies)
            except EngineUnavailable as error:
                warnings.warn(f"{error} Simulating in plain Python, about 100 times slower.", stacklevel=3)
            else:
                self.ids = engine.ids
                return lambda steps, record, stop: run_loop(
                    steps, DT_S, self.every, self.clock, engine.addresses, engine.read, engine.write, engine.touching,
                    engine.read_count, engine.write_count, engine.touch_count,
                    program.states, self.models, self.grounds, self.tables, program.legs, program.gates,
                    program.points, program.cumulative, record, self.clearances, self.contacts, stop, STALL_S,
                    self.fixes,
                )  # fmt: skip
        from vehicle.slow import run_slow

        self.ids = np.array([body.id for body in self.bodies])
        return lambda steps, record, stop: run_slow(self, steps, DT_S, record, stop, STALL_S)

    def _result(self, outcome: int, record: Array) -> Run:
        names = {ALL_DONE: DONE, TOO_CLOSE: CONFLICT, STALLED: STALL, RUNNING: TIMEOUT}
        states = self.program.states
        finish = np.where(states["done"] == 1, states["done_time"], np.nan)
        conflict = self._conflict() if outcome == TOO_CLOSE else None
        return Run(
            plan=self.plan,
            outcome=names[outcome],
            time_s=np.arange(len(record), dtype=np.float64) * (DT_S * self.every),
            record=record,
            finish_s=finish,
            contacts=self._first_touches(),
            min_clearance_m=float(self.clearances.min()),
            conflict=conflict,
        )

    def _conflict(self) -> Conflict:
        states, pair = self.program.states, self.pair
        legs = [int(states["leg"][i] - states["first_leg"][i]) for i in pair]
        ends = self.program.legs["end"]
        starts = [float(ends[states["leg"][i] - 1]) if leg else 0.0 for i, leg in zip(pair, legs, strict=True)]
        done = [float(states["progress"][i]) - start for i, start in zip(pair, starts, strict=True)]
        return Conflict(float(self.clock[0] * DT_S), int(pair[0]), int(pair[1]), *legs, *done)

    def _first_touches(self) -> tuple[tuple[float, int, int], ...]:
        """Each touching pair once, at the time it first touched."""
        number = {int(identity): index for index, identity in enumerate(self.ids)}
        seen: dict[tuple[int, int], float] = {}
        for time, a, b in self.contacts[: int(self.contacts[-1, 0])]:
            pair = sorted((number[int(a)], number[int(b)]))
            seen.setdefault((pair[0], pair[1]), float(time))
        return tuple((time, *pair) for pair, time in seen.items())


def simulate(plan: Plan, tractor: Tractor, implement: Implement, **options: Any) -> Run:
    """Build a world for the plan and run it; options as for World.run."""
    return World(plan, tractor, implement).run(**options)


def drive_circle(
    tractor: Tractor, steering_deg: float, ground: str, *, corrected: bool = True, seconds: float = 60.0,
    speed_mps: float = CIRCLE_SPEED_MPS,
) -> Circle:  # fmt: skip
    """Drive with the wheels at a fixed angle and measure the circle of the antenna over the last second.

    Without correction the angle goes straight to the base model, up to its own larger lock.
    """
    index = ground_index(ground)
    if not corrected:
        tractor = tractor.model_copy(update={"max_steering_deg": BASE_LOCK_DEG})
        tables = np.array([identity_table(BASE_LOCK_DEG)] * len(GROUNDS))
    else:
        tables = steering_tables(tractor)
    space = pymunk.Space()
    engine = Engine(space, [make_body(space, tractor, Implement(), (0.0, 0.0, math.pi / 2))])
    states = np.zeros(1, dtype=STATE)
    # The wheels stand at the angle from the start: Eq. 2.8 would leave them up to its dead band short of it.
    states["command"] = states["steering"] = math.radians(steering_deg)
    states["target_speed"] = speed_mps
    states["stage"] = 1
    steps = round(seconds / DT_S)
    track = np.empty((steps, 6))
    run_fixed(
        steps, DT_S, engine.addresses, engine.read, engine.write, engine.read_count, engine.write_count,
        states, np.array([compile_model(tractor, Implement())]), compile_grounds(), index, tables, track,
    )  # fmt: skip
    reach = tractor.antenna_forward_m - tractor.rear_axle_m
    antenna = track[:, :2] + reach * np.stack([np.cos(track[:, 2]), np.sin(track[:, 2])], axis=1)
    velocity = track[-60:, 3:5] + reach * track[-60:, 5:6] * np.stack(
        [-np.sin(track[-60:, 2]), np.cos(track[-60:, 2])], axis=1
    )
    radius = np.hypot(*velocity.T) / np.maximum(np.abs(track[-60:, 5]), 1e-12)
    return Circle(antenna, float(radius.mean()))
