"""How fast the simulation is, beside a plain pymunk loop and beside the bare formulas, all measured in one run.

    python -m tests.benchmarks.bench_loop            # about ten seconds
    python -m tests.benchmarks.bench_loop --quick    # two seconds, coarse

Every variant drives the same plan: a formation in which each tractor keeps behind its neighbour by gates, with
U-turns at the ends of the tracks. The variants take turns, and the best CPU time of each counts, so that a busy
machine slows all of them or none.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tests.benchmarks.bare_loop import BareWorld
from tests.benchmarks.plain_pymunk import PlainWorld
from vehicle.gnss import default_table
from vehicle.ground import tyres_on
from vehicle.layout import DT_S
from vehicle.missions import TRACK, TURN, Gate, Leg, Mission, Plan, Task
from vehicle.tractor import Implement, load_tractor
from vehicle.trials.drive import compile_tyres
from vehicle.world import World

SIZES = (1, 9, 25, 50)
SPEED_MPS = 5.0 / 3.6
FIELD_M, SHORT_M, WIDTH_M, STAGGER_M, RADIUS_M = 270.0, 12.0, 3.0, 8.0, 4.5
PLAIN_SECONDS = 20.0
LOOP, BARE, PLAIN = "headland", "bare formulas", "plain pymunk"
FULL = "headland with tyre models and GNSS error"
# By number of tractors, how many times faster than plain pymunk a loop is that cannot carry tyre models, GNSS errors
# and measured effects at all: measured by this benchmark on one that could not (CHANGELOG), Python 3.11, pymunk 7.3.
# The plain loop was the same, so the share of that speed left with all of them neutral can be told on any machine.
WITHOUT_EFFECTS = {1: 31.9, 9: 31.8, 25: 30.0, 50: 29.8}
LEAST_KEPT = 0.8
LEAST_OF_BARE = 0.65


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


def formation_plan(tractors: int, length: float = FIELD_M, passes: int = 4) -> Plan:
    """Tractor i works 3 m beside and 8 m behind tractor i - 1, and turns when that one is 6 m into its turn."""
    shift = max(2 * RADIUS_M, WIDTH_M * tractors)
    return Plan(tuple(Mission(_legs(i, shift, length, passes)) for i in range(tractors)))


def _legs(tractor: int, shift: float, length: float, passes: int) -> tuple[Leg, ...]:
    legs: list[Leg] = []
    start = -STAGGER_M * tractor
    for number in range(passes):
        x = WIDTH_M * tractor + shift * number
        y, end = (start, length) if number % 2 == 0 else (length, 0.0)
        start = 0.0
        gates = (Gate(tractor - 1, len(legs), 6.0),) if tractor else ()
        legs.append(Leg(np.array([[x, y], [x, end]]), SPEED_MPS, implement=True, task=Task(TRACK), gates=gates))
        if number < passes - 1:
            gates = (Gate(tractor - 1, len(legs), 6.0),) if tractor else ()
            legs.append(Leg(_u_turn(x, end, shift, up=number % 2 == 0), SPEED_MPS, task=Task(TURN), gates=gates))
    return tuple(legs)


def _u_turn(x: float, y: float, shift: float, *, up: bool) -> npt.NDArray[np.float64]:
    """Quarter circle, straight across, quarter circle to the track `shift` metres east."""
    angles = np.radians(np.arange(0.0, 91.0, 3.0))
    out = np.stack([RADIUS_M * (1 - np.cos(angles)), RADIUS_M * np.sin(angles)], axis=1)
    back = np.stack([shift - out[::-1, 0], out[::-1, 1]], axis=1)
    points = np.concatenate([out, back if shift > 2 * RADIUS_M else back[1:]])
    return np.array([x, y]) + points * np.array([1.0, 1.0 if up else -1.0])


def new_world(tractors: int, length: float = FIELD_M) -> World:
    """A world at the start of the plan."""
    return World(formation_plan(tractors, length), load_tractor("eg105"), Implement())


def full_world(tractors: int) -> World:
    """The same world on shaped tyres with a friction circle, and with GNSS error."""
    plan, tractor = formation_plan(tractors), load_tractor("eg105")
    world = World(plan, tractor, Implement(), position_errors=default_table())
    world.grounds = compile_tyres([tyres_on("asphalt", "nonlinear"), tyres_on("asphalt", "linear")])
    return world


def prepare(variant: str, tractors: int, seconds: float) -> tuple[Callable[[], None], Callable[[], int]]:
    """What is timed, ready to start, and how many tractor-steps it took afterwards."""
    world, steps = full_world(tractors) if variant == FULL else new_world(tractors), round(seconds / DT_S)
    if variant in (LOOP, FULL):
        # The world runs whole chunks of simulated time, so the steps are counted, not assumed.
        return lambda: _checked(world, seconds), lambda: int(world.clock[0]) * tractors
    if variant == BARE:
        bare = BareWorld(world, steps)
        return lambda: bare.run(steps), lambda: steps * tractors
    plain = PlainWorld(world)
    steps = min(steps, round(PLAIN_SECONDS / DT_S), max(60, round(2e4 / tractors)))
    return lambda: plain.run(steps), lambda: steps * tractors


def _checked(world: World, seconds: float) -> None:
    run = world.run(max_time_s=seconds)
    if run.contacts or run.outcome not in ("timeout", "done"):
        raise RuntimeError(f"The benchmark plan went wrong: {run.outcome}, contacts {run.contacts}.")


def measure(sizes: tuple[int, ...], seconds: float, repeats: int) -> dict[tuple[str, int], Timing]:
    """Best timing per variant and size; the variants take turns."""
    best: dict[tuple[str, int], Timing] = {}
    for variant in (LOOP, FULL, BARE, PLAIN):
        prepare(variant, 2, 1.0)[0]()  # compiles
    for _ in range(repeats):
        for tractors in sizes:
            for variant in (LOOP, FULL, BARE, PLAIN):
                work, steps = prepare(variant, tractors, seconds)
                start = time.process_time()
                work()
                found = Timing(time.process_time() - start, steps())
                known = best.get((variant, tractors))
                if known is None or found.micros < known.micros:
                    best[variant, tractors] = found
    return best


def difference(tractors: int, seconds: float) -> float:
    """Largest difference (m, rad, m/s) between the records of the three variants over `seconds`.

    The field is short, so that turns and waiting at gates are part of it; refuses a drive without turns.
    """
    steps = round(seconds / DT_S)
    rows = steps // 6
    record = new_world(tractors, SHORT_M).run(max_time_s=seconds).record[:rows, :, :6]
    if np.abs(record[:, :, 3]).max() < math.radians(20.0):
        raise RuntimeError("The tractors drove no turn in the time compared.")
    bare = BareWorld(new_world(tractors, SHORT_M), steps)
    bare.run(steps)
    plain = PlainWorld(new_world(tractors, SHORT_M))
    plain.run(steps)
    others = (bare.record[:rows, :, :6], np.array(plain.record).reshape(-1, tractors, 6)[:rows])
    return max(float(np.abs(other[: len(record)] - record).max()) for other in others)


def report(best: dict[tuple[str, int], Timing], sizes: tuple[int, ...]) -> str:
    """The table and the targets."""
    lines = ["  tractors   M steps/s   us/step   bare us   x bare   plain us   x plain"]
    for n in sizes:
        loop, bare, plain = (best[variant, n] for variant in (LOOP, BARE, PLAIN))
        lines.append(
            f"  {n:8d}   {loop.millions:9.2f}   {loop.micros:7.3f}   {bare.micros:7.3f}   "
            f"{loop.micros / bare.micros:6.2f}   {plain.micros:8.2f}   {plain.micros / loop.micros:7.1f}"
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
    targets.append(("of the speed of the bare formulas, at least", share, LEAST_OF_BARE, True))
    for n in sizes:
        if n in WITHOUT_EFFECTS:
            kept = best[PLAIN, n].micros / best[LOOP, n].micros / WITHOUT_EFFECTS[n]
            targets.append((f"of the speed without effects, {n:2d}, at least", kept, LEAST_KEPT, True))
    if 9 in sizes and 50 in sizes:
        growth = best[LOOP, 50].micros / best[LOOP, 9].micros
        targets.append(("cost at 50 over cost at 9, at most", growth, 1.5, False))
    for name, found, target, least in targets:
        met = found >= target if least else found <= target
        lines.append(f"  {name:44s} {target:5.2f}: {found:6.2f}   {'met' if met else 'MISSED'}")
    exponent = _exponent(best, sizes)
    if math.isfinite(exponent):
        lines.append(f"  cost of a step of the whole fleet grows as n^{exponent:.2f}")
    return "\n".join(lines)


def _exponent(best: dict[tuple[str, int], Timing], sizes: tuple[int, ...]) -> float:
    """Slope of log cost over log n for the whole fleet; nan for one size."""
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
    apart = difference(3, 40.0)
    print(f"All variants drive the same tracks: largest difference {apart:.1e} (m, rad, m/s)")
    if apart > 1e-6:
        raise SystemExit("The variants do not drive the same tracks; their times cannot be compared.")
    print(f"Up to {seconds:.0f} s of a formation with U-turns and gates at 60 Hz, best CPU time of {repeats}")
    print(report(measure(sizes, seconds, repeats), sizes))


if __name__ == "__main__":
    main()
