"""Who steers the fifth reference, and the runs: parts of a run are arcs to follow, angles to hold, or weaving.

A part is a row: how (below), end (s), value (deg, or m beside the arc), curvature of the arc (1/m) or period of the
weaving (s), speed (m/s, negative in reverse), implement, shuttle. An arc begins where the tractor is when its part
begins. Drivers: pure pursuit, Stanley, and a person who looks now and then and turns the wheel by whole degrees.
"""

import math
from collections.abc import Sequence

import numba
import numpy as np
import numpy.typing as npt

from tests.truth.ground import EG105, measured_angle

Array = npt.NDArray[np.float64]
BASE, MOST_DEG, BEAT_ROWS = 2.4, 24.0, 10
HOLD, PURSUE, STANLEY, PERSON, WEAVE = 0.0, 1.0, 2.0, 3.0, 4.0
EAST, NORTH, HEADING, SPEED, ROLL, MAST_M = 0, 1, 2, 5, 9, 2.7
PROGRAMMES = ("field", "yard", "both", "right_only", "one_speed")
SLOW, ROAD, FAST = 0.85, 1.4, 2.2


@numba.njit(cache=True)
def choose_command(
    trace: Array, row: int, part: Array, command: float, seen: Array, hands: Array, guide: Array, memory: Array
) -> float:  # fmt: skip
    """Command (deg) of this row; `memory` is start of the part (m, m, rad), and when the person looks again (row).

    `guide`: rows that position and heading are late, antenna ahead and to the right, ahead as assumed, heading bias.
    """
    time = row * 0.005
    if part[0] == HOLD:
        return float(part[2])
    if part[0] == WEAVE:
        return float(part[2] * math.sin(2.0 * math.pi * time / part[3]))
    if row % BEAT_ROWS or (part[0] == PERSON and row < memory[3]):
        return command
    old, turned = max(row - 1 - int(guide[0]), 0), max(row - 1 - int(guide[1]), 0)
    true, heading = trace[old, HEADING], trace[turned, HEADING] + guide[5]
    right = guide[3] + MAST_M * trace[old, ROLL]
    east = trace[old, EAST] + guide[2] * math.sin(true) + right * math.cos(true) + seen[row, 0]
    north = trace[old, NORTH] + guide[2] * math.cos(true) - right * math.sin(true) + seen[row, 1]
    east += -guide[4] * math.sin(heading) - memory[0]
    north += -guide[4] * math.cos(heading) - memory[1]
    s, c, bend = math.sin(memory[2]), math.cos(memory[2]), part[3]
    x, y = east * s + north * c, east * c - north * s
    way = math.atan2(bend * x, 1.0 - bend * y)
    off = y if bend == 0.0 else 1.0 / bend - math.copysign(math.hypot(x, y - 1.0 / bend), bend)
    off = min(max(off - part[2], -1.2), 1.2)
    error = heading - memory[2] - way
    error = math.atan2(math.sin(error), math.cos(error))
    if part[0] == STANLEY:
        aside = off + BASE * math.sin(error)
        wanted = -error - math.atan(0.6 * aside / (0.6 + abs(trace[row - 1 if row else 0, SPEED])))
        wanted = math.degrees(wanted) + measured_angle(bend, EG105)
    else:
        reach = 3.5 if part[0] == PURSUE else 5.0
        wanted = measured_angle(bend + 2.0 * math.sin(-math.asin(off / reach) - error) / reach, EG105)
    if part[0] == PERSON:
        memory[3] = row + 60.0 + 40.0 * min(abs(hands[row]), 2.5)
        wanted = round(wanted + 0.8 * hands[row - 1])
    return float(min(max(wanted, -MOST_DEG), MOST_DEG))


def lay_parts(*parts: tuple[float, float, float, float, float, float]) -> Array:
    """Rows of parts from (how, seconds, value, arc, speed, implement); the shuttle follows the speed."""
    end, rows, gear = 0.0, [], 1.0
    for how, seconds, value, arc, speed, tool in parts:
        end += seconds
        gear = math.copysign(1.0, speed) if speed else gear
        rows.append((how, end, value, arc, speed, tool, gear))
    return np.array(rows, dtype=np.float64)


def lay_field(rng: np.random.Generator, driver: float, paces: Sequence[float], seconds: float = 26.0) -> Array:
    """Three passes along arcs with the implement down, with a headland turn after each that backs up once."""
    arc, side = float(rng.choice([-1.0, 1.0])) * rng.uniform(0.008, 0.03), float(rng.choice([-1.0, 1.0]))
    rows: list[tuple[float, float, float, float, float, float]] = [(HOLD, 2.0, 0.0, 0.0, 0.0, 0.0)]
    for index in range(3):
        pace = float(paces[index % len(paces)])
        rows += [
            (driver, 4.0, 0.0, arc, pace, 0.0),
            (driver, 0.5 * seconds, 0.0, arc, pace, 1.0),
            (driver, 0.5 * seconds, rng.uniform(-0.5, 0.5), arc, float(rng.choice(paces)), 1.0),
        ]
        if index < 2:
            lock = side * rng.uniform(18.0, 24.0)
            rows += [(HOLD, 9.0, lock, 0.0, ROAD, 0.0), (HOLD, 3.0, 0.0, 0.0, 0.0, 0.0),
                     (HOLD, 7.0, -lock, 0.0, -SLOW, 0.0), (HOLD, 3.0, 0.0, 0.0, 0.0, 0.0),
                     (HOLD, 8.0, lock, 0.0, ROAD, 0.0)]  # fmt: skip
            arc = -arc
    return lay_parts(*rows)


def lay_spiral(rng: np.random.Generator, side: float, paces: Sequence[float]) -> Array:
    """Bends to one side (0: to both in turn), in any order of sizes, at changing speed."""
    count = int(rng.integers(6, 9))
    sizes = rng.permutation(np.linspace(rng.uniform(2.0, 4.0), rng.uniform(20.0, 25.0), count))
    signs = [side or (1.0 if index % 2 else -1.0) for index in range(count)]
    pace = np.where(sizes > 18.0, paces[-1], rng.choice(paces, count))  # as fast as it gets where it is tightest
    return lay_parts(*[(HOLD, rng.uniform(7.0, 11.0), sign * size, 0.0, float(speed), 0.0)
                       for sign, size, speed in zip(signs, sizes, pace, strict=True)])  # fmt: skip


def lay_jerks(rng: np.random.Generator, most: float, paces: Sequence[float]) -> Array:
    """A person at play with the wheel: angles up to a size, each held for some seconds, and back to the middle."""
    angles = rng.uniform(0.3, 1.0, 16) * most * rng.choice([-1.0, 1.0], 16) * (rng.random(16) > 0.2)
    pace = [float(rng.choice(paces)) for _ in range(4)]
    return lay_parts(*[(HOLD, rng.uniform(2.5, 5.0), float(angle), 0.0, pace[index // 4], 0.0)
                       for index, angle in enumerate(angles)])  # fmt: skip


def lay_straight(rng: np.random.Generator, driver: float, paces: Sequence[float]) -> Array:
    """Straight ahead with halts and the implement now and then; by no one's hand, or along a line."""
    pace = [float(rng.choice(paces)) for _ in range(4)]
    return lay_parts((HOLD, 2.0, 0.0, 0.0, 0.0, 0.0), (driver, 14.0, 0.0, 0.0, pace[0], 0.0),
                     (driver, 12.0, 0.0, 0.0, pace[1], 1.0), (HOLD, 4.0, 0.0, 0.0, 0.0, 0.0),
                     (driver, 14.0, 0.0, 0.0, pace[2], 1.0), (driver, 14.0, 0.0, 0.0, pace[3], 0.0))  # fmt: skip


def lay_weave(rng: np.random.Generator, size: float, paces: Sequence[float]) -> Array:
    """A sine of the wheel, slow and then faster, the implement in the second half of each."""
    rows = [(WEAVE, 14.0, size, period, float(rng.choice(paces)), float(index % 2))
            for index, period in enumerate((14.0, 14.0, 7.0, 7.0))]  # fmt: skip
    return lay_parts(*rows)


def build_programme(name: str, seed: int) -> list[tuple[str, Array, float]]:
    """Runs: name, parts, first heading (deg). Raises ValueError for a name not in PROGRAMMES."""
    rng = np.random.default_rng([seed, 53])
    paces = (SLOW, ROAD, FAST) if name != "one_speed" else (float(rng.uniform(1.2, 1.8)),)
    way = float(rng.uniform(0.0, 360.0))
    field = [(f"field_{index}", lay_field(rng, driver, paces), way + 180.0 * index)
             for index, driver in enumerate((PURSUE, STANLEY, PERSON))]  # fmt: skip
    yard = [("out", lay_straight(rng, HOLD, paces), way), ("back", lay_straight(rng, HOLD, paces), way + 180.0),
            ("right", lay_spiral(rng, 1.0, paces), way), ("left", lay_spiral(rng, -1.0, paces), way),
            ("jerks", lay_jerks(rng, 22.0, paces), way), ("small_jerks", lay_jerks(rng, 2.2, paces), way),
            ("weave", lay_weave(rng, 6.0, paces), way)]  # fmt: skip
    runs = {
        "field": [*field, ("field_3", lay_field(rng, STANLEY, paces), way + 90.0), *yard[2:4]],
        "yard": [*yard, ("turns", lay_spiral(rng, 0.0, paces), way)],
        "both": [field[1], field[2], *yard],
        "right_only": [(f"right_{index}", lay_spiral(rng, 1.0, paces), way) for index in range(5)],
        "one_speed": [*yard, ("turns", lay_spiral(rng, 0.0, paces), way)],
    }
    if name not in runs:
        raise ValueError(f"The programme {name!r} is unknown; use one of: {', '.join(PROGRAMMES)}.")
    return runs[name]
