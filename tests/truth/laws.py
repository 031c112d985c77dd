"""Laws of parameters as rows of numbers that compiled steps evaluate, and the parameters that machines share."""

import math
from collections.abc import Mapping

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
WIDTH, EDGE_M = 7, 6
# fmt: off
(P_OFFSET, P_GAIN, P_LEFT, P_DEAD_TIME, P_LAG, P_RATE, P_DEAD_BAND, P_PLAY, P_LIMIT, P_UNDERSTEER, P_SLOPE, P_DRAFT,
 P_SLIP, P_TOOL_SLIP, P_SPEED_LAG, P_PATCH, P_DRIFT) = range(17)
BODY_EFFECTS = {name: place for place, name in enumerate((
    "steering_offset", "steering_gain", "steering_asymmetry", "steering_dead_time", "steering_lag", "steering_rate",
    "steering_deadband", "steering_backlash", "side_slip", "understeer", "cross_slope_drift", "implement_side_draft",
    "wheel_slip", "implement_slip", "speed_lag", "grip_patch", "grip_drift",
))}
# fmt: on
"""Effects of a machine's body, and the places of their first values among its parameters; others are of instruments."""
NAMES = ("offset", "gain", "left_gain", "dead_time", "lag", "rate", "dead_band", "play", "limit", "understeer", "slope",
         "draft", "slip", "tool_slip", "speed_lag", "patch", "drift")  # fmt: skip


def encode_law(law: Law, run: int, edge_m: float = 0.0) -> Array:
    """A row of numbers for a run: kind, up to five values in the order of KEYS, width of a patch's edge.

    Raises KeyError for a value that the kind needs and the law lacks.
    """
    kind, given = law.kind, law.values
    if kind == "by_run":
        kind, given = "constant", {"value": given["value" if run == round(given["run"]) else "other"]}
    if kind == "by_place" and "inside" in given:
        kind = "patch"
    given = {"phase_deg": 0.0, "per_m_east": 0.0, "per_m_north": 0.0} | dict(given)
    row = np.zeros(WIDTH)
    row[0], row[EDGE_M] = NUMBERS[kind], edge_m
    row[1 : 1 + len(KEYS[kind])] = [given[key] for key in KEYS[kind]]
    return row


def name_parameters(values: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """The parameters of a body by name, from those of all effects; `limit` is finite, `slope_to` a bearing in rad."""
    known = {name: float(next(iter(values[effect].values()))) for name, effect in zip(NAMES, BODY_EFFECTS, strict=True)}
    known["limit"] = min(known["limit"], 1e3)
    known |= {f"patch_{key}": values["grip_patch"][f"{key}_m"] for key in ("east", "north", "radius")}
    return known | {"slope_to": math.radians(values["cross_slope_drift"]["bearing_deg"])}


def follow_law(case: TruthCase, effect: str, run: int, here: Array) -> Array:
    """An instrument's value in every row (k,), by its law if it has one.

    `here` (k, 7): time of the run, clock of the day (s), east, north (m), implement, wheel angle (deg), speed (m/s).
    """
    law = next((law for law in case.laws if law.effect == effect), None)
    if law is None:
        return np.full(len(here), next(iter(complete(case.effects)[effect].values())))
    return evaluate_rows(encode_law(law, run), here)


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
    kind, a, b, c, d, e = int(law[0]), law[1], law[2], law[3], law[4], law[5]
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
