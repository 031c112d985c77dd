"""Laws of parameters as rows of numbers that compiled steps evaluate, and the parameters that machines share."""

import math
from collections.abc import Mapping, Sequence

import numba
import numpy as np
import numpy.typing as npt

from tests.truth.cases import Law, TruthCase
from tests.truth.effects import complete

Array = npt.NDArray[np.float64]
KEYS = {
    "constant": ("value",),
    "over_minutes": ("start", "per_minute"),
    "over_day": ("mean", "amplitude", "period_s", "phase_deg"),
    "by_place": ("at_origin", "per_m_east", "per_m_north"),
    "patch": ("inside", "outside", "east_m", "north_m", "radius_m"),
    "by_implement": ("lifted", "working"),
    "by_side": ("left", "right"),
    "by_angle": ("at_0", "at_27"),
    "by_speed": ("at_0", "per_mps"),
}
NUMBERS = {name: number for number, name in enumerate(KEYS)}
WIDTH, EDGE_M = 8, 7
# fmt: off
(P_OFFSET, P_GAIN, P_LEFT, P_DEAD_TIME, P_LAG, P_RATE, P_DEAD_BAND, P_PLAY, P_LIMIT, P_UNDERSTEER, P_SLOPE, P_DRAFT,
 P_SLIP, P_TOOL_SLIP, P_SPEED_LAG, P_PATCH, P_DRIFT, P_SLOPE_TO, P_PATCH_E, P_PATCH_N, P_PATCH_R) = range(21)
BODY_EFFECTS = {name: place for place, name in enumerate((
    "steering_offset", "steering_gain", "steering_asymmetry", "steering_dead_time", "steering_lag", "steering_rate",
    "steering_deadband", "steering_backlash", "side_slip", "understeer", "cross_slope_drift", "implement_side_draft",
    "wheel_slip", "implement_slip", "speed_lag", "grip_patch", "grip_drift",
))}
# fmt: on
"""Effects of a machine's body, and the places of their first values among its parameters; others are of instruments."""
NAMES = ("offset", "gain", "left_gain", "dead_time", "lag", "rate", "dead_band", "play", "limit", "understeer", "slope",
         "draft", "slip", "tool_slip", "speed_lag", "patch", "drift", "slope_to", "patch_east", "patch_north",
         "patch_radius")  # fmt: skip


def encode_law(law: Law, parameter: int, run: int, edge_m: float = 0.0) -> Array:
    """A row of numbers for a run: parameter, kind, up to five values in the order of KEYS, width of a patch's edge.

    Raises KeyError for a value that the kind needs and the law lacks.
    """
    kind, given = law.kind, law.values
    if kind == "by_run":
        kind, given = "constant", {"value": given["value" if run == round(given["run"]) else "other"]}
    if kind == "by_place" and "inside" in given:
        kind = "patch"
    given = {"phase_deg": 0.0, "per_m_east": 0.0, "per_m_north": 0.0} | dict(given)
    row = np.zeros(WIDTH)
    row[:2], row[EDGE_M] = (parameter, NUMBERS[kind]), edge_m
    row[2 : 2 + len(KEYS[kind])] = [given[key] for key in KEYS[kind]]
    return row


def name_parameters(values: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """The parameters of a body by name, from those of all effects; `limit` is finite, `slope_to` a bearing in rad."""
    base = fill_common(values)
    return {name: float(value) for name, value in zip(NAMES, base, strict=True)}


def fill_common(values: Mapping[str, Mapping[str, float]]) -> Array:
    """The parameters that all bodies share (21,)."""
    slope, patch = values["cross_slope_drift"], values["grip_patch"]
    places = [math.radians(slope["bearing_deg"]), *(patch[key] for key in ("east_m", "north_m", "radius_m"))]
    base = np.array([*(next(iter(values[name].values())) for name in BODY_EFFECTS), *places])
    base[P_LIMIT] = min(base[P_LIMIT], 1e3)
    return base


def stack_laws(rows: Sequence[Array]) -> Array:
    """Rows of encode_law as an array (n, WIDTH)."""
    return np.array(rows).reshape(-1, WIDTH)


def fill_parameters(case: TruthCase, run: int, count: int) -> tuple[Array, Array]:
    """Parameters of a machine in a run: the common ones and zeros up to `count`, and its laws (n, WIDTH)."""
    base = np.zeros(count)
    base[: len(NAMES)] = fill_common(complete(case.effects))
    laws = [encode_law(law, BODY_EFFECTS[law.effect], run) for law in case.laws if law.effect in BODY_EFFECTS]
    return base, stack_laws(laws)


def follow_law(case: TruthCase, effect: str, run: int, here: Array) -> Array:
    """An instrument's value in every row (k,), by its law if it has one.

    `here` (k, 7): time of the run, clock of the day (s), east, north (m), implement, wheel angle (deg), speed (m/s).
    """
    law = next((law for law in case.laws if law.effect == effect), None)
    if law is None:
        return np.full(len(here), next(iter(complete(case.effects)[effect].values())))
    return evaluate_rows(encode_law(law, -1, run), here)


@numba.njit(cache=True)
def evaluate_rows(law: Array, here: Array) -> Array:
    """Values of a law in rows as of follow_law."""
    out = np.empty(len(here))
    for i in range(len(here)):
        h = here[i]
        out[i] = evaluate_law(law, h[0], h[1], h[2], h[3], h[4], h[5], h[5], h[6])
    return out


@numba.njit(cache=True)
def evaluate_law(
    law: Array, time: float, clock: float, east: float, north: float, down: float, side: float, wheel: float,
    speed: float,
) -> float:  # fmt: skip
    """Value of a parameter now: `time` of the run, `clock` of the day (s), `side` right when positive."""
    kind, a, b, c, d, e = int(law[1]), law[2], law[3], law[4], law[5], law[6]
    if kind == 1:
        return a + b * time / 60.0
    if kind == 2:
        return a + b * math.sin(2.0 * math.pi * clock / c + math.radians(d))
    if kind == 3:
        return a + b * east + c * north
    if kind == 4:
        beyond = (math.hypot(east - c, north - d) - e) / max(law[EDGE_M], 1e-9)
        return b + (a - b) * min(max(0.5 - beyond, 0.0), 1.0)
    if kind == 5:
        return a + (b - a) * down
    if kind == 6:
        return b if side > 0.0 else a
    if kind == 7:
        return a + (b - a) * min(abs(wheel), 27.0) / 27.0
    if kind == 8:
        return a + b * abs(speed)
    return a


@numba.njit(cache=True)
def evaluate_laws(
    laws: Array, base: Array, p: Array, time: float, clock: float, east: float, north: float, down: float, wheel: float,
    move: float, speed: float,
) -> None:  # fmt: skip
    """Write the parameters in force to `p`: those of `base` that no law governs stay.

    Lag, rate and dead band take the side to which the wheels are to `move`, others that to which they stand.
    """
    for i in range(len(laws)):
        place = int(laws[i, 0])
        side = move if P_LAG <= place <= P_DEAD_BAND else wheel
        p[place] = evaluate_law(laws[i], time, clock, east, north, down, side, wheel, speed)


@numba.njit(cache=True)
def compute_path_factor(p: Array, east: float, north: float, time: float, left: bool) -> float:
    """Factor on the curvature from all that changes how well a machine turns; the edge of a patch is sharp."""
    factor = p[P_GAIN] * (1.0 + p[P_DRIFT] * time / 60.0) * (p[P_LEFT] if left else 1.0)
    if p[P_PATCH] != 1.0 and math.hypot(east - p[P_PATCH_E], north - p[P_PATCH_N]) < p[P_PATCH_R]:
        factor *= p[P_PATCH]
    return factor
