"""The cases of the sixth reference: what is hidden, how large, and how the logger merges its messages.

A seed has half of the effects of the catalogue in clear sizes, and the next seed the other half.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from tests.truth.cases import Law, TruthCase
from tests.truth.drawing import (
    EITHER_WAY,
    Cause,
    Drawers,
    Rng,
    build_case,
    draw_kinds,
    draw_ranges,
    pick,
    pick_names,
)
from tests.truth.effects import NEUTRAL, Effects
from tests.truth.sixth import PROGRAMMES

CLEAR: dict[str, tuple[float, float]] = {
    "steering_offset": (1.0, 1.8), "steering_gain": (0.08, 0.15), "steering_asymmetry": (0.10, 0.17),
    "steering_dead_time": (0.25, 0.45), "steering_lag": (0.35, 0.6), "steering_rate": (6.5, 9.5),
    "steering_deadband": (1.0, 1.8), "steering_backlash": (1.5, 2.6), "side_slip": (0.06, 0.08),
    "understeer": (2.0, 3.2), "cross_slope_drift": (0.03, 0.05), "implement_side_draft": (0.006, 0.011),
    "wheel_slip": (0.08, 0.15), "implement_slip": (0.10, 0.18), "speed_lag": (1.2, 2.0),
    "antenna_forward": (0.4, 0.8), "antenna_right": (0.15, 0.3), "gnss_latency": (0.2, 0.4),
    "heading_bias": (1.5, 2.6), "grip_patch": (0.25, 0.38), "grip_drift": (0.10, 0.16),
}  # fmt: skip
"""Clear sizes of the first parameter: away from neutral where that is 0 or a ratio of 1, else as it is."""
AS_IT_IS = ("steering_lag", "steering_rate", "steering_deadband", "side_slip")
FAINT = tuple(name for name in CLEAR if name not in (*AS_IT_IS, "grip_patch"))
"""Also at a third to a half of a clear size: a name is welcome and none is no fault."""
PAIRS = (
    ("steering_gain", "wheel_slip"), ("steering_offset", "antenna_right"), ("steering_dead_time", "implement_slip"),
    ("heading_bias", "steering_asymmetry"), ("understeer", "speed_lag"), ("implement_side_draft", "steering_lag"),
    ("steering_backlash", "cross_slope_drift"), ("gnss_latency", "steering_rate"), ("antenna_forward", "grip_drift"),
)  # fmt: skip
OUTSIDE: dict[str, Cause] = {
    "crosswind": ({"force_n": (4500.0, 7000.0), "bearing_deg": (0.0, 360.0)},
                  ("direction", "bearing", "heading", "time"), ("cross_slope_drift",)),
    "steering_hunt": ({"angle_deg": (1.4, 2.4), "period_s": (2.0, 4.0)},
                      ("steering", "wheel", "period", "swing", "time"), ()),
    "mast_sway": ({"m_per_mps2": (0.08, 0.14), "hertz": (0.6, 1.1)},
                  ("antenna", "position", "lateral", "swing", "period"), ()),
    "soft_tyre": ({"moment_nm": (1200.0, 2200.0)}, ("angle", "steering", "side", "curvature"), ("steering_offset",)),
}  # fmt: skip


def draw_value(name: str, rng: Rng, share: float = 1.0) -> dict[str, float]:
    """Parameters of an effect at a share of a clear size, to either side where it has two."""
    neutral, size, first = NEUTRAL[name], float(rng.uniform(*CLEAR[name])), next(iter(NEUTRAL[name]))
    sign = float(rng.choice([-1.0, 1.0])) if name in EITHER_WAY else -1.0 if name == "grip_patch" else 1.0
    values = {first: size if name in AS_IT_IS else neutral[first] + sign * share * size}
    places = {"bearing_deg": (0.0, 360.0), "east_m": (-9.0, 9.0), "north_m": (-9.0, 9.0), "radius_m": (11.0, 17.0)}
    return values | {key: float(rng.uniform(*places[key])) for key in neutral if key != first}


def make_case(kind: str, seed: int, effects: Effects, rng: Rng, **fields: Any) -> TruthCase:
    """A case of effects of the catalogue and nothing else."""
    return build_case(kind, seed, effects, programme=str(rng.choice(PROGRAMMES)), **fields)


def draw_effects(rng: Rng, seed: int) -> list[TruthCase]:
    """Half of the effects in clear sizes, and three faint ones."""
    turn = seed // 1000
    names = np.random.default_rng([turn // 2, 64]).permutation(list(NEUTRAL)).tolist()[turn % 2 :: 2]
    cases = [make_case("effect", seed + k, {name: draw_value(name, rng)}, rng) for k, name in enumerate(names)]
    for k, name in enumerate(pick_names(FAINT, 3, rng)):
        faint = {name: draw_value(name, rng, float(rng.uniform(0.33, 0.5)))}
        cases.append(make_case("effect", seed + 20 + k, faint, rng, wanted=()))
    return cases


def draw_laws(rng: Rng, seed: int) -> list[TruthCase]:
    """Two of the laws: with speed, over the day, over minutes or with the implement."""
    side, size = float(rng.choice([-1.0, 1.0])), float(rng.uniform(1.0, 1.4))
    plan = (
        Law("steering_gain", "by_speed", {"at_0": 1.0 + 0.12 * size * side, "per_mps": -0.12 * size * side}),
        Law("steering_offset", "over_day", {"mean": 0.0, "amplitude": 1.5 * size,
            "period_s": float(rng.uniform(1500.0, 2100.0)), "phase_deg": float(rng.uniform(0.0, 360.0))}),
        Law("steering_offset", "over_minutes", {"start": 0.0, "per_minute": 1.6 * size * side}),
        Law("steering_offset", "by_implement", {"lifted": 0.0, "working": 1.5 * size * side}),
        Law("wheel_slip", "by_speed", {"at_0": 0.01, "per_mps": 0.05 * size}),
    )  # fmt: skip
    alike = {"by_implement": ["implement_side_draft"]}
    return [make_case("law", seed + k, {}, rng, laws=(law,), also=alike.get(law.kind, ()))
            for k, law in enumerate(pick(plan, 2, rng))]  # fmt: skip


DRAWERS: Drawers = {
    "clean": lambda rng, seed: [make_case("clean", seed + k, {}, rng) for k in range(3)],
    "effect": draw_effects,
    "pair": lambda rng, seed: [make_case("pair", seed + k, {name: draw_value(name, rng) for name in names}, rng)
                               for k, names in enumerate(pick(PAIRS, 3, rng))],
    "law": draw_laws,
    "outside": lambda rng, seed: [
        make_case("outside", seed + k, {}, rng, outside={name: draw_ranges(OUTSIDE[name][0], rng)},
                  words=OUTSIDE[name][1], also=OUTSIDE[name][2]) for k, name in enumerate(pick_names(OUTSIDE, 2, rng))
    ],
}  # fmt: skip


def draw_sixth_cases(seed: int, kinds: Collection[str] | None = None) -> list[TruthCase]:
    """All cases of a seed, or those of some kinds (none of most). Raises ValueError for an unknown kind."""
    return draw_kinds(seed, kinds, DRAWERS, 65)
