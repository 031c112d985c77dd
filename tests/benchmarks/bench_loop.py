"""Speed of the simulation, compared with a plain pymunk loop and with the bare formulas, all measured in one run.

    python -m tests.benchmarks.bench_loop            # about ten seconds
    python -m tests.benchmarks.bench_loop --quick    # two seconds, coarse

Every variant drives the same plan: a formation in which gates hold each tractor behind its neighbour, with U-turns at
the ends of the swaths. The variants take turns, and the best CPU time of each counts, so that a busy machine slows all
of them or none.

The bare loop has the same formulas on plain arrays, no shapes, no contacts: the rest of the full loop is pymunk.
"""

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from fields.arrays import Floats
from tests.benchmarks.plain_pymunk import PlainWorld
from vehicle.control.guidance import run_control_tick
from vehicle.jit import drop_owner
from vehicle.missions.plan import SWATH, TURN, Leg, LegGate, LegTask, Mission, Plan
from vehicle.model.gnss import load_default_error_table
from vehicle.model.ground import get_tyres
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import Implement, load_tractor
from vehicle.model.work_load import WorkLoad
from vehicle.records import DT_S
from vehicle.sim.clearance import find_too_close
from vehicle.sim.compile import build_tyre_ground_records
from vehicle.sim.loop import drive_tractor, write_record_row
from vehicle.sim.world import World

SIZES = (1, 9, 25, 50)
SPEED_MPS = 5.0 / 3.6
FIELD_M, SHORT_M, WIDTH_M, STAGGER_M, RADIUS_M = 270.0, 12.0, 3.0, 8.0, 4.5
PLAIN_SECONDS = 20.0
LOOP, BARE, PLAIN = "headland", "bare formulas", "plain pymunk"
FULL = "headland with tyre models and GNSS errors"
TERRAIN = "headland on hills, with draft and slip"
# By number of tractors, the speed over that of plain pymunk of a loop without tyre models, GNSS errors and measured
# effects, measured by this benchmark (see guide) with Python 3.11 and pymunk 7.3. The plain loop was the same, so that
# the share of that speed with all of them neutral can be compared on any machine.
WITHOUT_EFFECTS = {1: 31.9, 9: 31.8, 25: 30.0, 50: 29.8}
MIN_SPEED_SHARE = 0.8
MIN_BARE_SHARE, MIN_BARE_SHARE_ON_TERRAIN = 0.65, 0.5
HILL_SPACING_M = 5.0


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def run_bare_steps(  # type: ignore[no-untyped-def]
    steps, dt, every, bodies, force, states, models, grounds, tables, legs, gates, points, cumulative, record,
    clearances, starts,
):  # fmt: skip
    """Advance `bodies` (n, 6: x, y, angle, vx, vy, spin) as pymunk does: places first, with the old velocity."""
    bodies, force, states, models = drop_owner(bodies), drop_owner(force), drop_owner(states), drop_owner(models)
    grounds, tables, legs, gates = drop_owner(grounds), drop_owner(tables), drop_owner(legs), drop_owner(gates)
    points, cumulative, record, clearances, starts = (
        drop_owner(points),
        drop_owner(cumulative),
        drop_owner(record),
        drop_owner(clearances),
        drop_owner(starts),
    )
    count = len(states)
    for step in range(steps):
        if step % every == 0:
            for i in range(count):
                states[i].x, states[i].y, states[i].angle = bodies[i, 0], bodies[i, 1], bodies[i, 2]
            for i in range(count):
                run_control_tick(i, states, models, legs, gates, points, cumulative, step * dt, every * dt)
            write_record_row(record, step // every, states)
            find_too_close(states, models, clearances, starts, -1.0, -1.0)
        for i in range(count):
            model = models[states[i].model]
            ground = legs[states[i].leg].ground
            drive_tractor(states[i], model, grounds, ground, tables[states[i].model, ground], bodies[i], force, dt)
            bodies[i, 0] += bodies[i, 3] * dt
            bodies[i, 1] += bodies[i, 4] * dt
            bodies[i, 2] += bodies[i, 5] * dt
            bodies[i, 3] += force[0] / model.mass * dt
            bodies[i, 4] += force[1] / model.mass * dt
            bodies[i, 5] += force[2] / model.inertia * dt


class BareWorld:
    """The bodies and arrays of a World, driven without pymunk."""

    def __init__(self, world: World, steps: int) -> None:
        self.world = world
        self.bodies = np.array([[*b.position, b.angle, *b.velocity, b.angular_velocity] for b in world.bodies])
        self.record: Any = np.empty((steps // world.steps_per_tick + 1, len(world.bodies), 7))

    def run(self, steps: int) -> None:
        """Advance by `steps` of 1/60 s."""
        world, program = self.world, self.world.program
        run_bare_steps(
            steps, DT_S, world.steps_per_tick, self.bodies, np.zeros(3), program.states, world.models, world.grounds,
            world.tables, program.legs, program.gates, program.points, program.cumulative, self.record,
            world.clearances, world.start_distances,
        )  # fmt: skip


@dataclass(frozen=True)
class Timing:
    """Best CPU seconds for a number of tractor-steps."""

    seconds: float
    steps: int

    @property
    def micros(self) -> float:
        """Microseconds per tractor-step."""
        return 1e6 * self.seconds / self.steps

    @property
    def millions(self) -> float:
        """Million tractor-steps a second."""
        return 1e-6 * self.steps / self.seconds


def build_formation_plan(tractors: int, length: float = FIELD_M, passes: int = 4) -> Plan:
    """Tractor i works 3 m beside and 8 m behind tractor i - 1, and turns when i - 1 is 6 m into its turn."""
    shift = max(2 * RADIUS_M, WIDTH_M * tractors)
    return Plan(tuple(Mission(_build_legs(i, shift, length, passes)) for i in range(tractors)))


def _build_legs(tractor: int, shift: float, length: float, passes: int) -> tuple[Leg, ...]:
    legs: list[Leg] = []
    start = -STAGGER_M * tractor
    for number in range(passes):
        x = WIDTH_M * tractor + shift * number
        y, end = (start, length) if number % 2 == 0 else (length, 0.0)
        start = 0.0
        gates = (LegGate(tractor - 1, len(legs), 6.0),) if tractor else ()
        legs.append(Leg(np.array([[x, y], [x, end]]), SPEED_MPS, implement=True, task=LegTask(SWATH), gates=gates))
        if number < passes - 1:
            gates = (LegGate(tractor - 1, len(legs), 6.0),) if tractor else ()
            legs.append(
                Leg(_build_u_turn(x, end, shift, up=number % 2 == 0), SPEED_MPS, task=LegTask(TURN), gates=gates)
            )
    return tuple(legs)


def _build_u_turn(x: float, y: float, shift: float, *, up: bool) -> Floats:
    """Quarter circle, straight across, quarter circle to the swath `shift` metres east."""
    angles = np.radians(np.arange(0.0, 91.0, 3.0))
    out = np.stack([RADIUS_M * (1 - np.cos(angles)), RADIUS_M * np.sin(angles)], axis=1)
    back = np.stack([shift - out[::-1, 0], out[::-1, 1]], axis=1)
    points = np.concatenate([out, back if shift > 2 * RADIUS_M else back[1:]])
    return np.array([x, y]) + points * np.array([1.0, 1.0 if up else -1.0])


def build_world(tractors: int, length: float = FIELD_M) -> World:
    """A world at the start of the plan."""
    return World(build_formation_plan(tractors, length), load_tractor("eg105"), Implement())


def build_full_world(tractors: int) -> World:
    """The same world on shaped tyres with a friction circle, and with GNSS errors."""
    plan, tractor = build_formation_plan(tractors), load_tractor("eg105")
    world = World(plan, tractor, Implement(), position_errors=load_default_error_table())
    world.grounds = build_tyre_ground_records([get_tyres("asphalt", "nonlinear"), get_tyres("asphalt", "linear")])
    return world


def build_terrain_world(tractors: int) -> World:
    """The same world on hills of up to 8 % slope, with an implement that is drawn and wheels that slip."""
    plan = build_formation_plan(tractors)
    points = np.concatenate([leg.points for mission in plan.missions for leg in mission.legs])
    low, high = points.min(axis=0) - 20.0, points.max(axis=0) + 20.0
    x, y = np.meshgrid(*(np.arange(start, end, HILL_SPACING_M) for start, end in zip(low, high, strict=True)))
    heights = 3.0 * np.sin(x / 45.0) * np.cos(y / 60.0) + 0.02 * y
    load = WorkLoad(
        draft_n=(5000.0, 500.0, 0.0), implement_mass_kg=800.0, rolling_share=0.065, engine_power_w=77e3,
        driveline_efficiency=0.86, mobility_number=40.0, centre_height_m=1.0,
    )  # fmt: skip
    terrain = Terrain(float(low[0]), float(low[1]), HILL_SPACING_M, heights)
    return World(plan, load_tractor("eg105"), Implement(), terrain=terrain, load=load)


def prepare_variant(variant: str, tractors: int, seconds: float) -> tuple[Callable[[], None], Callable[[], int]]:
    """The function to time, ready to start, and one that gives the number of tractor-steps afterwards."""
    build = {FULL: build_full_world, TERRAIN: build_terrain_world}.get(variant, build_world)
    world, steps = build(tractors), round(seconds / DT_S)
    if variant in (LOOP, FULL, TERRAIN):
        # The world runs whole chunks of simulated time, so the steps are counted, not assumed.
        return lambda: _run_checked(world, seconds), lambda: int(world.clock[0]) * tractors
    if variant == BARE:
        bare = BareWorld(world, steps)
        return lambda: bare.run(steps), lambda: steps * tractors
    plain = PlainWorld(world)
    steps = min(steps, round(PLAIN_SECONDS / DT_S), max(60, round(2e4 / tractors)))
    return lambda: plain.run(steps), lambda: steps * tractors


def _run_checked(world: World, seconds: float) -> None:
    run = world.run(max_time_s=seconds)
    if run.contacts or run.outcome not in ("timeout", "done"):
        raise RuntimeError(f"The benchmark plan failed: outcome {run.outcome}, contacts {run.contacts}.")


def measure_timings(sizes: tuple[int, ...], seconds: float, repeats: int) -> dict[tuple[str, int], Timing]:
    """Best timing per variant and size; the variants take turns."""
    best: dict[tuple[str, int], Timing] = {}
    for variant in (LOOP, FULL, TERRAIN, BARE, PLAIN):
        prepare_variant(variant, 2, 1.0)[0]()  # compiles
    for _ in range(repeats):
        for tractors in sizes:
            for variant in (LOOP, FULL, TERRAIN, BARE, PLAIN):
                work, steps = prepare_variant(variant, tractors, seconds)
                start = time.process_time()
                work()
                found = Timing(time.process_time() - start, steps())
                known = best.get((variant, tractors))
                if known is None or found.micros < known.micros:
                    best[variant, tractors] = found
    return best


def compute_difference(tractors: int, seconds: float) -> float:
    """Largest difference (m, rad, m/s) between the records of the three variants over `seconds`.

    The field is short, so that turns and waiting at gates are included. Raises RuntimeError for a drive without turns.
    """
    steps = round(seconds / DT_S)
    rows = steps // 6
    record = build_world(tractors, SHORT_M).run(max_time_s=seconds).record[:rows, :, :6]
    if np.abs(record[:, :, 3]).max() < math.radians(20.0):
        raise RuntimeError("The tractors drove no turn in the compared time.")
    bare = BareWorld(build_world(tractors, SHORT_M), steps)
    bare.run(steps)
    plain = PlainWorld(build_world(tractors, SHORT_M))
    plain.run(steps)
    others = (bare.record[:rows, :, :6], np.array(plain.record).reshape(-1, tractors, 6)[:rows])
    return max(float(np.abs(other[: len(record)] - record).max()) for other in others)


def format_report(best: dict[tuple[str, int], Timing], sizes: tuple[int, ...]) -> str:
    """The table of timings and the targets."""
    lines = ["  tractors   M steps/s   us/step   bare us   x bare   plain us   x plain   on terrain   x bare"]
    for n in sizes:
        loop, bare, plain = (best[variant, n] for variant in (LOOP, BARE, PLAIN))
        lines.append(
            f"  {n:8d}   {loop.millions:9.2f}   {loop.micros:7.3f}   {bare.micros:7.3f}   "
            f"{loop.micros / bare.micros:6.2f}   {plain.micros:8.2f}   {plain.micros / loop.micros:7.1f}   "
            f"{best[TERRAIN, n].micros:10.3f}   {best[TERRAIN, n].micros / bare.micros:6.2f}"
        )
    large = [n for n in sizes if n >= 9]
    targets: list[tuple[str, float, float, bool]] = []
    if 1 in sizes:
        targets.append(("M steps/s alone, at least", best[LOOP, 1].millions, 2.0, True))
    if large:
        targets.append(("M steps/s for 9 and more, at least", min(best[LOOP, n].millions for n in large), 3.0, True))
    full = min(best[FULL, n].millions for n in sizes)
    targets.append(("M steps/s with tyres and GNSS, at least", full, 2.0, True))
    gain = min(best[PLAIN, n].micros / best[LOOP, n].micros for n in sizes)
    targets.append(("times plain pymunk, at least", gain, 25.0, True))
    share = min(best[BARE, n].micros / best[LOOP, n].micros for n in sizes)
    targets.append(("of the speed of the bare formulas, at least", share, MIN_BARE_SHARE, True))
    share = min(best[BARE, n].micros / best[TERRAIN, n].micros for n in sizes)
    targets.append(("of that speed on terrain with a load, at least", share, MIN_BARE_SHARE_ON_TERRAIN, True))
    for n in sizes:
        if n in WITHOUT_EFFECTS:
            kept = best[PLAIN, n].micros / best[LOOP, n].micros / WITHOUT_EFFECTS[n]
            targets.append((f"of the speed without effects, {n:2d}, at least", kept, MIN_SPEED_SHARE, True))
    if 9 in sizes and 50 in sizes:
        growth = best[LOOP, 50].micros / best[LOOP, 9].micros
        targets.append(("cost at 50 over cost at 9, at most", growth, 1.5, False))
    for name, found, target, least in targets:
        met = found >= target if least else found <= target
        lines.append(f"  {name:44s} {target:5.2f}: {found:6.2f}   {'met' if met else 'MISSED'}")
    exponent = _fit_exponent(best, sizes)
    if math.isfinite(exponent):
        lines.append(f"  cost of a step of the whole fleet grows as n^{exponent:.2f}")
    return "\n".join(lines)


def _fit_exponent(best: dict[tuple[str, int], Timing], sizes: tuple[int, ...]) -> float:
    """Slope of log cost over log n for the whole fleet; nan for a single size."""
    if len(sizes) < 2:
        return math.nan
    cost = [math.log(best[LOOP, n].micros * n) for n in sizes]
    return float(np.polyfit(np.log(sizes), cost, 1)[0])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="Speed of the simulation, all variants in one run.")
    parser.add_argument("--quick", action="store_true", help="one small round, coarse figures")
    quick = parser.parse_args().quick
    sizes, seconds, repeats = ((1, 3), 20.0, 1) if quick else (SIZES, 600.0, 5)
    apart = compute_difference(3, 40.0)
    print(f"All variants drive the same paths: largest difference {apart:.1e} (m, rad, m/s)")
    if apart > 1e-6:
        raise SystemExit("The variants do not drive the same paths; their times cannot be compared.")
    print(f"Up to {seconds:.0f} s of a formation with U-turns and gates at 60 Hz, best CPU time of {repeats}")
    print(format_report(measure_timings(sizes, seconds, repeats), sizes))


if __name__ == "__main__":
    main()
