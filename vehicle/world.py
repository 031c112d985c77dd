"""A pymunk space with tractors in it, driven by a plan."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.bodies import ContactBoxes, make_body, new_space
from vehicle.calibration import steering_tables
from vehicle.compile import CompiledPlan, compile_grounds, compile_model, compile_plan
from vehicle.engine import Engine, EngineUnavailable
from vehicle.gnss import NO_ERROR, error_keys
from vehicle.layout import DT_S, RECORD
from vehicle.loop import ALL_DONE, APART, NEIGHBOURS, RUNNING, STALLED, TOO_CLOSE, run_loop
from vehicle.missions import Plan, check_plan
from vehicle.run import CONFLICT, DONE, STALL, TIMEOUT, Conflict, Run
from vehicle.slow import Scene, run_slow
from vehicle.tractor import Implement, Tractor

CHUNK_S = 600.0  # of simulated time between two calls of `progress`
LONGER, LONGER_S = 1.1, 60.0  # than its speeds ask for a run is expected to take; more room for its record is as cheap
GROWN = 1.5  # times as much room where that is not enough
STALL_S = 120.0  # in which no tractor of the plan gets on: far longer than a change of gear
Array = npt.NDArray[Any]


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A world in the middle of a run without contacts: all it takes to go on from there bit for bit.

    `motion` (n, 6) are x, y, angle, velocity and spin of the bodies, the first `rows` of `chunks` the record so far.
    The legs and segments of the `states` are counted from the first of each tractor, so that another plan may have
    others behind them.
    """

    clock: Array
    states: Array
    clearances: Array
    motion: Array
    near: Array
    chunks: Sequence[Array]
    rows: int

    @property
    def time_s(self) -> float:
        """When it was taken."""
        return float(self.clock[0] * DT_S)

    @property
    def step(self) -> int:
        """The steps before it."""
        return int(self.clock[0])

    def within(self, record: Array) -> Snapshot:
        """The same with its rows in the record of the whole run, so that they are held once."""
        return replace(self, chunks=(record[: self.rows],))

    def record(self) -> list[Array]:
        """The record so far, in parts; there may be more in `chunks`."""
        parts, left = [], self.rows
        for chunk in self.chunks:
            parts.append(chunk[:left])
            left -= len(parts[-1])
            if not left:
                break
        return parts


class World:
    """Executes one plan. Every tractor is of the same kind and carries the same implement.

    `position_errors` is a GNSS table of vehicle.gnss, from which each tractor draws errors of its own by the `seed`.
    """

    def __init__(
        self, plan: Plan, tractor: Tractor, implement: Implement, *, tables: Array | None = None,
        position_errors: Array | None = None, seed: int = 1,
    ) -> None:  # fmt: skip
        check_plan(plan)
        self.plan = plan
        self.program: CompiledPlan = compile_plan(plan, tractor)
        self.models = np.array([compile_model(tractor, implement)])
        self.grounds = compile_grounds()
        self.tables = (steering_tables(tractor) if tables is None else tables)[None]
        self.position_errors = NO_ERROR if position_errors is None else position_errors
        self.program.states["error_key"] = error_keys(seed, plan.tractors)
        self.every = max(1, round(1.0 / (tractor.guidance.rate_hz * DT_S)))
        self.space = new_space()
        poses = [(float(s["x"]), float(s["y"]), float(s["angle"])) for s in self.program.states]
        self.bodies = [make_body(self.space, tractor, pose) for pose in poses]
        self.boxes = ContactBoxes(self.space, self.bodies, tractor, implement)
        self.clock = np.zeros(3)
        self.clearances = np.full(plan.tractors, np.inf)
        self.contacts = np.zeros((256, 3))
        self.pair = (-1, -1)
        self.rows = 0
        self._record: Array = np.empty((0, plan.tractors, len(RECORD)))
        self.outcome = RUNNING

    def run(
        self,
        *,
        stop_clearance_m: float = -1.0,
        beside_clearance_m: float | None = None,
        max_time_s: float = 4 * 86400.0,
        progress: Callable[[float], None] | None = None,
        slow: bool = False,
        apart: bool = False,
        chunk_s: float = CHUNK_S,
    ) -> Run:
        """Simulate until every tractor is done, two come closer than `stop_clearance_m`, or nothing moves any more.

        Two on parallel lines beside each other (vehicle.clearance) may come as close as `beside_clearance_m`.
        `progress` is called with the share of all path length driven, every `chunk_s` of simulated time. `slow` takes
        the plain Python loop. Tractors that are `apart` drive through each other, and no clearance is measured.
        """
        advance = self._chooser(slow)
        stop_clearance_m = APART if apart else stop_clearance_m
        stop = stop_clearance_m, stop_clearance_m if beside_clearance_m is None else beside_clearance_m
        most = math.ceil(max_time_s / DT_S)
        expected_s = min(self._expected_s, max_time_s)
        outcome = RUNNING
        total = float(sum(self.program.legs["end"][s["last_leg"]] for s in self.program.states))
        while outcome == RUNNING and self.clock[0] < most:
            steps = min(round(chunk_s / DT_S), most - int(self.clock[0]))
            chunk = self._room(math.ceil(steps / self.every) + 1, expected_s)
            outcome, rows, *self.pair = advance(steps, chunk, stop)
            self.outcome = outcome
            self.rows += rows
            if progress:
                progress(min(1.0, float(self.program.states["progress"].sum()) / total))
        return self._result(outcome, self._record[: self.rows])

    def snapshot(self) -> Snapshot | None:
        """The world between two steps; None when it has stopped in one, or tractors have touched: pymunk remembers."""
        if self.outcome != RUNNING or self.contacts[-1, 0] > 0:
            return None
        motion = [(*body.position, body.angle, *body.velocity, body.angular_velocity) for body in self.bodies]
        states, (legs, segments) = self.program.states.copy(), self._first_places()
        states["leg"] -= legs
        states["segment"] -= segments
        return Snapshot(
            self.clock.copy(), states, self.clearances.copy(), np.array(motion), self.boxes.near.copy(),
            (self._record,), self.rows,
        )  # fmt: skip

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from a snapshot of a world whose plan was the same as far as it was driven, and as it was looked ahead.

        What lies behind that may be other legs, and any number of them.
        """
        states, own, (legs, segments) = snapshot.states.copy(), self.program.states, self._first_places()
        states["leg"] += legs
        states["segment"] += segments
        for name in ("first_leg", "last_leg", "leaves"):
            states[name] = own[name]
        self.clock[:], own[:] = snapshot.clock, states
        self.clearances[:], self.boxes.wanted[:] = snapshot.clearances, snapshot.near
        for body, (x, y, angle, vx, vy, spin) in zip(self.bodies, snapshot.motion.tolist(), strict=True):
            body.position, body.angle, body.velocity, body.angular_velocity = (x, y), angle, (vx, vy), spin
        self.boxes.bring()
        self.rows, self._record = 0, np.empty((0, *self._record.shape[1:]))
        for part in snapshot.record():
            self._room(len(part))[:] = part
            self.rows += len(part)

    def _room(self, rows: int, expected_s: float = 0.0) -> Array:
        """Room for so many more rows behind those of the record.

        It is taken at once for as long as the run is expected to take: what is not written to takes no memory.
        """
        if self.rows + rows > len(self._record):
            expected = math.ceil(expected_s / (DT_S * self.every)) + 1
            count = max(self.rows + rows, expected, math.ceil(GROWN * len(self._record)))
            wider = np.empty((count, *self._record.shape[1:]))
            wider[: self.rows] = self._record[: self.rows]
            self._record = wider
        return self._record[self.rows : self.rows + rows]

    @property
    def _expected_s(self) -> float:
        """About how long the plan takes where hardly anybody waits."""
        alone = (
            math.fsum(leg.stand_s + leg.length_m / leg.speed_mps for leg in mission.legs)
            for mission in self.plan.missions
        )
        return LONGER * max(alone) + LONGER_S

    @property
    def ends_m(self) -> list[Array]:
        """Where the legs of each tractor end, counted from its start."""
        first, ends = self.program.states["first_leg"], self.program.legs["end"]
        return np.split(ends, first[1:])

    def _first_places(self) -> tuple[Array, Array]:
        """The first leg and the first segment of each tractor (n,) in the arrays of the program."""
        legs = self.program.states["first_leg"].copy()
        return legs, self.program.legs["first_segment"][legs]

    def _chooser(self, slow: bool) -> Callable[[int, Array, tuple[float, float]], Any]:
        if not slow:
            try:
                engine = Engine(self.space, self.bodies)
            except EngineUnavailable as error:
                warnings.warn(f"{error} Simulating in plain Python, about 100 times slower.", stacklevel=3)
            else:
                self.ids = engine.ids
                return lambda steps, record, stop: self._advance(engine, steps, record, stop)
        self.ids = np.array([body.id for body in self.bodies])
        scene = Scene(
            self.space, self.bodies, self.boxes, self.program, self.models, self.grounds, self.tables,
            self.position_errors, self.every, self.clock, self.clearances, self.contacts,
        )  # fmt: skip
        return lambda steps, record, stop: run_slow(scene, steps, DT_S, record, stop, STALL_S)

    def _advance(self, engine: Engine, steps: int, record: Array, stop: tuple[float, float]) -> Any:
        """Run the compiled loop for so many steps, with contact boxes in the space where tractors are near others."""
        program, last, rows = self.program, int(self.clock[0]) + steps, 0
        while True:
            outcome, more, first, second = run_loop(
                last - int(self.clock[0]), DT_S, self.every, self.clock, engine.door,
                program.states, self.models, self.grounds, self.tables, program.legs, program.gates,
                program.points, program.cumulative, record[rows:], self.clearances, self.contacts, *stop, STALL_S,
                self.position_errors, self.boxes.near, self.boxes.wanted,
            )  # fmt: skip
            rows += more
            if outcome != NEIGHBOURS:
                return outcome, rows, first, second
            self.boxes.bring()

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
