"""Laws of parameters for the fourth reference, as rows of numbers that the compiled step can evaluate."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numba
import numpy as np
import numpy.typing as npt

from tests.truth.cases import Law

Array = npt.NDArray[np.float64]
KEYS = {
    "constant": ("value",),
    "over_minutes": ("start", "per_minute"),
    "over_day": ("mean", "amplitude", "period_s", "phase_deg"),
    "by_place": ("at_origin", "per_m_east", "per_m_north"),
    "patch": ("inside", "outside", "east_m", "north_m", "radius_m"),
    "by_run": ("run", "value", "other"),
    "by_implement": ("lifted", "working"),
    "by_side": ("left", "right"),
    "by_angle": ("at_0", "at_27"),
    "by_speed": ("at_0", "per_mps"),
}
NUMBERS = {name: number for number, name in enumerate(KEYS)}
WIDTH = 7
FIRST_BY_MOVE, LAST_BY_MOVE = 4, 6  # lag, rate and dead band take the side to which the wheels are to move


def encode_law(law: Law, parameter: int) -> Array:
    """A row of numbers: parameter, kind, and up to five values in the order of KEYS.

    Raises KeyError for a value that the kind needs and the law lacks.
    """
    kind = "patch" if law.kind == "by_place" and "inside" in law.values else law.kind
    defaults = {"phase_deg": 0.0, "per_m_east": 0.0, "per_m_north": 0.0}
    values = [law.values.get(key, defaults[key]) if key in defaults else law.values[key] for key in KEYS[kind]]
    row = np.zeros(WIDTH)
    row[:2], row[2 : 2 + len(values)] = (parameter, NUMBERS[kind]), values
    return row


def stack_laws(rows: Sequence[Array]) -> Array:
    """Rows of encode_law as an array (n, 7)."""
    return np.array(rows).reshape(-1, WIDTH)


@numba.njit(cache=True)
def evaluate_law(
    law: Array, time: float, clock: float, east: float, north: float, down: float, wheel: float, move: float,
    speed: float, run: int,
) -> float:  # fmt: skip
    """Value of a parameter now: `time` of the run, `clock` of the day (s), `move` what the wheel has to go."""
    kind, a, b, c, d, e = int(law[1]), law[2], law[3], law[4], law[5], law[6]
    if kind == 1:
        return a + b * time / 60.0
    if kind == 2:
        return a + b * math.sin(2.0 * math.pi * clock / c + math.radians(d))
    if kind == 3:
        return a + b * east + c * north
    if kind == 4:
        return a if math.hypot(east - c, north - d) < e else b
    if kind == 5:
        return b if run == int(a) else c
    if kind == 6:
        return b if down > 0.5 else a
    if kind == 7:
        side = move if FIRST_BY_MOVE <= int(law[0]) <= LAST_BY_MOVE else wheel
        return b if side > 0.0 else a
    if kind == 8:
        return a + (b - a) * min(abs(wheel) / 27.0, 1.0)
    if kind == 9:
        return a + b * abs(speed)
    return a


@numba.njit(cache=True)
def evaluate_laws(
    laws: Array, base: Array, p: Array, time: float, clock: float, east: float, north: float, down: float, wheel: float,
    move: float, speed: float, run: int,
) -> None:  # fmt: skip
    """Write the parameters in force to `p`: those of `base` that no law governs stay."""
    for i in range(len(laws)):
        p[int(laws[i, 0])] = evaluate_law(laws[i], time, clock, east, north, down, wheel, move, speed, run)
