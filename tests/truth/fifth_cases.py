"""The cases of the fifth reference: what is hidden, how large, in which drives and at which rate; some sizes are small.

Causes outside the catalogue are described in tests.truth.fifth and fifth_sensors.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from tests.truth.cases import ColumnClock, Fault, Law, TruthCase
from tests.truth.drawing import (
    LAW_WORDS,
    Cause,
    Drawers,
    Rng,
    build_case,
    draw_effect,
    draw_kinds,
    draw_one,
    draw_ranges,
    pick,
    pick_names,
)
from tests.truth.effects import NEUTRAL, Effects

RATES = (4.0, 8.0, 10.0, 12.5, 25.0)
ALIKE = {"steering_backlash": 0.5, "steering_gain": 0.3, "steering_offset": 0.3, "antenna_right": 0.35,
         "wheel_slip": 0.3, "heading_bias": 0.35, "steering_dead_time": 0.4, "implement_side_draft": 0.4}  # fmt: skip
"""Effects that come in small sizes too, and the share of the clear size: a name is welcome and none is no fault."""
CLOSED_EFFECTS = (
    "steering_offset", "steering_gain", "steering_dead_time", "antenna_right", "antenna_forward", "wheel_slip",
    "heading_bias", "implement_side_draft", "cross_slope_drift", "steering_rate", "implement_slip",
)  # fmt: skip
ONE_SIDED = ("steering_gain", "antenna_right", "steering_offset")
ONE_SPEED = ("understeer", "gnss_latency", "antenna_forward")
PAIRS = (
    ("steering_gain", "antenna_forward"), ("steering_offset", "implement_side_draft"), ("wheel_slip", "speed_lag"),
    ("heading_bias", "cross_slope_drift"), ("steering_backlash", "steering_dead_time"),
    ("gnss_latency", "antenna_right"), ("steering_rate", "understeer"), ("steering_asymmetry", "steering_deadband"),
    ("grip_drift", "implement_slip"), ("side_slip", "steering_lag"),
)  # fmt: skip
OUTSIDE: dict[str, Cause] = {
    "weight_shift": ({"share": (1.2, 1.9)}, ("implement", "work"),
                     ("understeer", "steering_gain")),
    "tyre_leak": ({"per_minute": (0.008, 0.012)}, ("time", "day", "run"), ("steering_offset",)),
    "axle_lock": ({"from_s": (5.0, 20.0)}, ("bend", "angle", "time", "turn"), ()),
    "crab_axle": ({"run": (2.0, 6.99), "angle_deg": (0.8, 1.5)}, ("run", "unlike"), ()),
    "boom_wind": ({"moment_nm": (2500.0, 4000.0), "bearing_deg": (0.0, 360.0)},
                  ("implement", "work", "direction", "bearing", "heading"), ()),
    "furrow_walls": ({"side_n": (3000.0, 4500.0)}, ("implement", "work", "place", "position"), ()),
    "weak_pump": ({"deg_per_s": (9.0, 13.0)}, ("speed", "steering"), ("steering_rate", "steering_lag")),
    "leaky_valve": ({"per_s": (0.15, 0.3)}, ("steering", "wheel", "angle"), ("steering_deadband", "steering_lag")),
    "pushed_tank": ({"mass_kg": (2500.0, 3500.0)}, ("speed", "start", "acceleration", "bend", "angle"),
                    ("speed_lag",)),
    "soft_springs": ({"ratio": (4.0, 6.0)}, ("lateral", "antenna", "position", "turn", "place"), ()),
    "gyro_scale": ({"share": (0.015, 0.03), "hold_s": (30.0, 60.0)}, ("heading", "turn", "bend"), ()),
    "wheel_hysteresis": ({"angle_deg": (1.2, 2.2)}, ("wheel sensor", "steering", "wheel"), ("steering_backlash",)),
    "mast_spring": ({"hertz": (0.5, 0.8), "damping": (0.04, 0.1)}, ("antenna", "position", "swing", "period"), ()),
    "roll_lever": ({"height_m": (4.0, 7.0)}, ("antenna", "position", "lateral", "place"), ()),
    "magnet": ({"size_deg": (-9.0, -5.0), "east_m": (-12.0, 12.0), "north_m": (-12.0, 12.0),
                "radius_m": (8.0, 14.0)}, ("heading", "place"), ()),
    "kalman_lag": ({"way_m": (0.4, 0.7)}, ("position", "speed"), ("position_delay", "clock_offset_position")),
    "grid_scale": ({"east": (1.02, 1.04)}, ("east", "place", "position", "bearing", "direction", "heading"), ()),
    "baseline_flex": ({"share": (1.0, 2.0)}, ("heading", "lateral"), ()),
    "rim_speed": ({"here": (1.0, 1.0)}, ("speed",), ()),
    "stamp_jitter": ({"time_s": (0.05, 0.09)}, ("time", "clock", "stamp"), ()),
    "course_heading": ({"here": (1.0, 1.0)}, ("heading",), ("heading_delay", "heading_filter")),
}  # fmt: skip


def draw_outside_case(name: str, rng: Rng, seed: int) -> TruthCase:
    """One cause outside the catalogue; rims that slip under draft come with the slip that they hide."""
    ranges, words, also = OUTSIDE[name]
    outside = {name: draw_ranges(ranges, rng)}
    effects: Effects = {"implement_slip": {"ratio": float(rng.uniform(0.05, 0.09))}} if name == "rim_speed" else {}
    rate = float(rng.choice(RATES)) if name != "stamp_jitter" else 8.0
    programme = "yard" if name == "course_heading" else "both"  # in reverse a course is no heading, and is refused
    return build_case("outside", seed, effects, outside=outside, programme=programme, rate_hz=rate, wanted=(),
                      also=also, words=words)  # fmt: skip


def make_case(kind: str, seed: int, effects: Effects, programme: str, rng: Rng) -> TruthCase:
    """A case of effects of the catalogue in clear sizes, and nothing else."""
    return build_case(kind, seed, effects, programme=programme, rate_hz=float(rng.choice(RATES)))


def make_cases(kind: str, seed: int, rows: Collection[Collection[str]], programme: str, rng: Rng) -> list[TruthCase]:
    """A case of clear effects for every row of names."""
    return [make_case(kind, seed + k, {name: draw_effect(name, rng) for name in names}, programme, rng)
            for k, names in enumerate(rows)]  # fmt: skip


def draw_clean(rng: Rng, seed: int) -> list[TruthCase]:
    """Nothing hidden: four rates, three programmes."""
    rates = rng.permutation(RATES)
    return [build_case("clean", seed + k, programme=name, rate_hz=float(rates[k]))
            for k, name in enumerate(("both", "field", "yard", "both"))]  # fmt: skip


def draw_effects(rng: Rng, seed: int) -> list[TruthCase]:
    """Nine clear effects and two small ones."""
    cases = make_cases("effect", seed, [(name,) for name in pick_names(NEUTRAL, 9, rng)], "both", rng)
    for k, name in enumerate(pick_names(ALIKE, 2, rng)):
        clear, neutral, share = draw_effect(name, rng), NEUTRAL[name], ALIKE[name]
        small = {key: neutral[key] + share * (value - neutral[key]) for key, value in clear.items()}
        cases.append(build_case("effect", seed + 9 + k, {name: small}, programme="both", wanted=()))
    return cases


def draw_columns(rng: Rng, seed: int) -> list[TruthCase]:
    """Three columns with a clock of their own."""
    late, side = float(rng.uniform(0.25, 0.45)), float(rng.choice([-1.0, 1.0]))
    plan: list[tuple[str, ColumnClock, list[str]]] = [
        ("position", ColumnClock(delay_s=late), []),
        ("heading", ColumnClock(delay_s=late), []),
        ("heading", ColumnClock(filter_s=late + 0.3), []),
        ("speed", ColumnClock(scale=1.0 + 0.07 * side), []),
        ("steering", ColumnClock(offset_s=late), []),
        ("steering_command", ColumnClock(offset_s=-side * late), ["steering_dead_time"]),
        ("position", ColumnClock(offset_s=-late), []),
        ("position", ColumnClock(drift_s_per_min=0.35 * side), []),
        ("steering", ColumnClock(hold_s=1.0, hold_jitter=0.1), []),
        ("position", ColumnClock(hold_s=0.8), ["position_delay"]),
    ]
    return [build_case("column", seed + k, columns={name: clock}, also=also, programme="both")
            for k, (name, clock, also) in enumerate(pick(plan, 3, rng))]  # fmt: skip


def draw_laws(rng: Rng, seed: int) -> list[TruthCase]:
    """Four laws: by time, side, load, place, angle or speed."""
    side, way, size = float(rng.choice([-1.0, 1.0])), float(rng.uniform(0.0, 2.0 * math.pi)), float(rng.uniform(1, 1.3))
    plan = [
        Law("steering_offset", "over_minutes", {"start": 0.0, "per_minute": 1.6 * size * side}),
        Law("steering_offset", "by_implement", {"lifted": 0.0, "working": 1.4 * size * side}),
        Law("steering_gain", "by_implement", {"lifted": 1.0, "working": 1.0 - 0.15 * size}),
        Law("steering_gain", "by_place", {"at_origin": 1.0, "per_m_east": 0.006 * size * math.sin(way),
                                          "per_m_north": 0.006 * size * math.cos(way)}),
        Law("steering_gain", "by_angle", {"at_0": 1.0 - 0.12 * side, "at_27": 1.0 + 0.14 * side}),
        Law("steering_gain", "over_day", {"mean": 1.0, "amplitude": 0.13 * size, "period_s": 6000.0,
                                          "phase_deg": math.degrees(way)}),
        Law("steering_rate", "by_side", {"left": 13.0 + 5.0 * side, "right": 13.0 - 5.0 * side}),
        Law("steering_deadband", "by_side", {"left": 0.9 + 0.8 * side, "right": 0.9 - 0.8 * side}),
        Law("wheel_slip", "by_place", {"at_origin": 0.06, "per_m_east": 0.0015 * math.sin(way),
                                       "per_m_north": 0.0015 * math.cos(way)}),
        Law("heading_bias", "over_day", {"mean": 0.0, "amplitude": 2.2 * size, "period_s": 5000.0,
                                         "phase_deg": math.degrees(way)}),
    ]  # fmt: skip
    alike = {"by_place": ["grip_patch"], "by_implement": ["implement_side_draft"]}
    return [
        build_case("law", seed + k, laws=(law,), words=LAW_WORDS[law.kind], programme="both",
                   also=alike.get(law.kind, ()) if law.effect in ("steering_gain", "steering_offset") else ())
        for k, law in enumerate(pick(plan, 4, rng))
    ]  # fmt: skip


def draw_faults(rng: Rng, seed: int) -> list[TruthCase]:
    """Four things that break in one run in which they are used: some heal, some last to the end."""
    side = float(rng.choice([-1.0, 1.0]))
    plan: list[tuple[str, dict[str, float], tuple[int, ...]]] = [
        ("steering_loose", {}, (6, 8)),
        ("steering_stuck", {"side": side}, (4, 5, 6)),
        ("position_lost", {"mode": 0.0, "size_m": float(rng.uniform(1.0, 2.0))}, (0, 1, 4, 5, 6)),
        ("position_lost", {"mode": 1.0, "size_m": float(rng.uniform(1.2, 3.0))}, (4, 5, 6, 7)),
        ("position_frozen", {}, (4, 5, 6, 7)),
        ("heading_frozen", {}, (4, 5, 6)),
        ("speed_frozen", {}, (4, 5, 6)),
        ("wheel_sensor_frozen", {}, (6, 8)),
    ]
    cases = []
    for k, (name, detail, runs) in enumerate(pick(plan, 4, rng)):
        start = float(rng.uniform(14.0, 28.0))
        fault = Fault(name, int(rng.choice(runs)), start, start + 14.0 if k % 2 else None, {"side": 1.0} | detail)
        cases.append(build_case("fault", seed + k, faults=(fault,), programme="both"))
    return cases


def draw_outside(rng: Rng, seed: int) -> list[TruthCase]:
    """A third of the causes outside the catalogue; three seeds in a row have them all."""
    turn = seed // 1000
    order = pick(OUTSIDE, len(OUTSIDE), np.random.default_rng([turn // 3, 56]))
    return [draw_outside_case(name, rng, seed + k) for k, name in enumerate(order[turn % 3 :: 3])]


def draw_odd_runs(rng: Rng, seed: int) -> list[TruthCase]:
    """One run of nine by a tractor that turns less, or stands askew."""
    plan = (("steering_gain", 1.0 - float(rng.uniform(0.14, 0.2)), 1.0),
            ("steering_offset", float(rng.choice([-1.0, 1.0]) * rng.uniform(1.4, 2.0)), 0.0))  # fmt: skip
    name, value, other = plan[int(rng.integers(2))]
    law = Law(name, "by_run", {"run": float(rng.integers(4, 7)), "value": value, "other": other})
    return [build_case("odd_run", seed, laws=(law,), wanted=(), words=("run",), programme="both")]


def draw_mixed(rng: Rng, seed: int) -> list[TruthCase]:
    """An effect beside a late column."""
    name = str(rng.choice(["steering_offset", "steering_gain", "wheel_slip", "antenna_right"]))
    late = {"position": ColumnClock(delay_s=float(rng.uniform(0.25, 0.4)))}
    return [build_case("mixed", seed, {name: draw_effect(name, rng)}, columns=late, programme="both")]


DRAWERS: Drawers = {
    "clean": draw_clean, "effect": draw_effects, "column": draw_columns, "law": draw_laws, "fault": draw_faults,
    "outside": draw_outside, "odd_run": draw_odd_runs, "mixed": draw_mixed,
    "pair": lambda rng, seed: make_cases("pair", seed, pick(PAIRS, 3, rng), "both", rng),
    "closed_loop": lambda rng, seed: make_cases(
        "closed_loop", seed, [(name,) for name in pick_names(CLOSED_EFFECTS, 2, rng)], "field", rng),
    # Bends to the right only, or one speed: clean, and with an effect that others can stand in for.
    "one_sided": lambda rng, seed: [build_case("one_sided", seed, programme="right_only"),
                                    make_case("one_sided", seed + 1, draw_one(ONE_SIDED, rng), "right_only", rng)],
    "one_speed": lambda rng, seed: [make_case("one_speed", seed, draw_one(ONE_SPEED, rng), "one_speed", rng)],
}  # fmt: skip


def draw_fifth_cases(seed: int, kinds: Collection[str] | None = None) -> list[TruthCase]:
    """All cases of a seed, or those of some kinds. Raises ValueError for an unknown kind."""
    return draw_kinds(seed, kinds, DRAWERS, 57)
