"""The cases of the fifth reference: what is hidden, how large, in which drives and at which rate; some sizes are small.

Causes outside the catalogue are described in tests.truth.fifth and fifth_sensors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection

import numpy as np

from tests.truth.cases import KINDS, ColumnClock, Fault, Law, TruthCase
from tests.truth.effects import NEUTRAL, Effects
from tests.truth.fourth_cases import draw_effect

Rng = np.random.Generator
RATES = (4.0, 8.0, 10.0, 12.5, 25.0)
ALIKE = {"steering_backlash": 0.5, "steering_gain": 0.3, "steering_offset": 0.3, "antenna_right": 0.35,
         "wheel_slip": 0.3, "heading_bias": 0.35, "steering_dead_time": 0.4, "implement_side_draft": 0.4}  # fmt: skip
"""Effects that come in small sizes too, and the share of the clear size: a name is welcome and none is no fault."""
PAIRS = (
    ("steering_gain", "antenna_forward"), ("steering_offset", "implement_side_draft"), ("wheel_slip", "speed_lag"),
    ("heading_bias", "cross_slope_drift"), ("steering_backlash", "steering_dead_time"),
    ("gnss_latency", "antenna_right"), ("steering_rate", "understeer"), ("steering_asymmetry", "steering_deadband"),
    ("grip_drift", "implement_slip"), ("side_slip", "steering_lag"),
)  # fmt: skip
OUTSIDE: dict[str, tuple[dict[str, tuple[float, float]], tuple[str, ...], tuple[str, ...]]] = {
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
"""Cause: ranges of its numbers, words of which one should be in a hint, and ids that would be right all the same."""


def draw_outside_case(name: str, rng: Rng, seed: int) -> TruthCase:
    """One cause outside the catalogue; rims that slip under draft come with the slip that they hide."""
    ranges, words, allowed = OUTSIDE[name]
    values = {key: float(rng.uniform(low, high)) for key, (low, high) in ranges.items()}
    if "run" in values:
        values["run"] = float(int(values["run"]))
    effects: Effects = {"implement_slip": {"ratio": float(rng.uniform(0.05, 0.09))}} if name == "rim_speed" else {}
    rate = float(rng.choice(RATES)) if name != "stamp_jitter" else 8.0
    programme = "yard" if name == "course_heading" else "both"  # in reverse a course is no heading, and is refused
    return TruthCase("outside", seed, effects, outside={name: values}, programme=programme, rate_hz=rate,
                     allowed=frozenset(allowed) | frozenset(effects), hint_words=words)  # fmt: skip


def make_case(kind: str, seed: int, effects: Effects, programme: str, rng: Rng) -> TruthCase:
    """A case of effects of the catalogue in clear sizes, and nothing else."""
    ids = frozenset(effects)
    return TruthCase(
        kind, seed, effects, programme=programme, rate_hz=float(rng.choice(RATES)), allowed=ids, wanted=ids
    )


def draw_clean(rng: Rng, seed: int) -> list[TruthCase]:
    """Nothing hidden: four rates, three programmes."""
    rates = rng.permutation(RATES)
    return [TruthCase("clean", seed + k, programme=name, rate_hz=float(rates[k]))
            for k, name in enumerate(("both", "field", "yard", "both"))]  # fmt: skip


def draw_effects(rng: Rng, seed: int) -> list[TruthCase]:
    """Nine clear effects and two small ones."""
    names = [str(name) for name in rng.permutation(list(NEUTRAL))][:9]
    cases = [make_case("effect", seed + k, {name: draw_effect(name, rng)}, "both", rng) for k, name in enumerate(names)]
    for k, name in enumerate(rng.permutation(list(ALIKE))[:2]):
        clear, neutral, share = draw_effect(str(name), rng), NEUTRAL[str(name)], ALIKE[str(name)]
        small = {key: neutral[key] + share * (value - neutral[key]) for key, value in clear.items()}
        cases.append(TruthCase("effect", seed + 9 + k, {str(name): small}, programme="both",
                               allowed=frozenset({str(name)})))  # fmt: skip
    return cases


def draw_pairs(rng: Rng, seed: int) -> list[TruthCase]:
    """Three pairs."""
    chosen = [PAIRS[place] for place in rng.permutation(len(PAIRS))[:3]]
    return [make_case("pair", seed + k, {name: draw_effect(name, rng) for name in names}, "both", rng)
            for k, names in enumerate(chosen)]  # fmt: skip


def draw_closed_loop(rng: Rng, seed: int) -> list[TruthCase]:
    """Two effects in a field that drivers steer through."""
    names = ("steering_offset", "steering_gain", "steering_dead_time", "antenna_right", "antenna_forward",
             "wheel_slip", "heading_bias", "implement_side_draft", "cross_slope_drift",
             "steering_rate", "implement_slip")  # fmt: skip
    return [make_case("closed_loop", seed + k, {str(name): draw_effect(str(name), rng)}, "field", rng)
            for k, name in enumerate(rng.permutation(names)[:2])]  # fmt: skip


def draw_columns(rng: Rng, seed: int) -> list[TruthCase]:
    """Three columns with a clock of their own."""
    late, side = float(rng.uniform(0.25, 0.45)), float(rng.choice([-1.0, 1.0]))
    plan: list[tuple[str, ColumnClock, set[str], set[str]]] = [
        ("position", ColumnClock(delay_s=late), {"position_delay"}, {"clock_offset_position"}),
        ("heading", ColumnClock(delay_s=late), {"heading_delay"}, {"clock_offset_heading"}),
        ("heading", ColumnClock(filter_s=late + 0.3), {"heading_filter"}, {"heading_delay"}),
        ("speed", ColumnClock(scale=1.0 + 0.07 * side), {"speed_scale"}, set()),
        ("steering", ColumnClock(offset_s=late), {"clock_offset_steering"}, set()),
        ("steering_command", ColumnClock(offset_s=-side * late), {"clock_offset_steering_command"},
         {"steering_dead_time"}),
        ("position", ColumnClock(offset_s=-late), {"clock_offset_position"}, set()),
        ("position", ColumnClock(drift_s_per_min=0.35 * side), {"clock_offset_position"}, set()),
        ("steering", ColumnClock(hold_s=1.0, hold_jitter=0.1), set(), set()),
        ("position", ColumnClock(hold_s=0.8), set(), {"position_delay"}),
    ]  # fmt: skip
    return [TruthCase("column", seed + k, columns={plan[place][0]: plan[place][1]}, programme="both",
                      allowed=frozenset(plan[place][2] | plan[place][3]), wanted=frozenset(plan[place][2]))
            for k, place in enumerate(rng.permutation(len(plan))[:3])]  # fmt: skip


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
    words = {"over_minutes": ("time", "minute"), "over_day": ("day", "time", "run"), "by_place": ("place", "east",
             "north"), "by_side": ("side", "left", "right"), "by_angle": ("angle",), "by_implement": ("implement",
             "work")}  # fmt: skip
    alike = {"by_place": {"grip_patch"}, "by_implement": {"implement_side_draft"}}
    cases = []
    for k, place in enumerate(rng.permutation(len(plan))[:4]):
        law = plan[place]
        more = alike.get(law.kind, set()) if law.effect in ("steering_gain", "steering_offset") else set()
        cases.append(TruthCase("law", seed + k, laws=(law,), programme="both", wanted=frozenset({law.effect}),
                               allowed=frozenset({law.effect}) | more, hint_words=words[law.kind]))  # fmt: skip
    return cases


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
    for k, place in enumerate(rng.permutation(len(plan))[:4]):
        name, detail, runs = plan[place]
        start = float(rng.uniform(14.0, 28.0))
        fault = Fault(name, int(rng.choice(runs)), start, start + 14.0 if k % 2 else None, {"side": 1.0} | detail)
        cases.append(TruthCase("fault", seed + k, faults=(fault,), programme="both", allowed=frozenset({name}),
                               wanted=frozenset({name})))  # fmt: skip
    return cases


def draw_outside(rng: Rng, seed: int) -> list[TruthCase]:
    """A third of the causes outside the catalogue; three seeds in a row have them all."""
    turn = seed // 1000
    order = np.random.default_rng([turn // 3, 56]).permutation(len(OUTSIDE))
    chosen = order[turn % 3 :: 3]
    return [draw_outside_case(list(OUTSIDE)[place], rng, seed + k) for k, place in enumerate(chosen)]


def draw_odd_runs(rng: Rng, seed: int) -> list[TruthCase]:
    """One run of nine by a tractor that turns less, or stands askew."""
    plan = (("steering_gain", 1.0 - float(rng.uniform(0.14, 0.2)), 1.0),
            ("steering_offset", float(rng.choice([-1.0, 1.0]) * rng.uniform(1.4, 2.0)), 0.0))  # fmt: skip
    name, value, other = plan[int(rng.integers(2))]
    law = Law(name, "by_run", {"run": float(rng.integers(4, 7)), "value": value, "other": other})
    return [TruthCase("odd_run", seed, laws=(law,), programme="both", allowed=frozenset({name}), hint_words=("run",))]


def draw_one_sided(rng: Rng, seed: int) -> list[TruthCase]:
    """Bends to the right only: clean, and with an effect that others can stand in for."""
    name = str(rng.choice(["steering_gain", "antenna_right", "steering_offset"]))
    return [TruthCase("one_sided", seed, programme="right_only"),
            make_case("one_sided", seed + 1, {name: draw_effect(name, rng)}, "right_only", rng)]  # fmt: skip


def draw_one_speed(rng: Rng, seed: int) -> list[TruthCase]:
    """One speed: clean, or with what one speed hides."""
    name = str(rng.choice(["understeer", "gnss_latency", "antenna_forward"]))
    return [make_case("one_speed", seed, {name: draw_effect(name, rng)}, "one_speed", rng)]


def draw_mixed(rng: Rng, seed: int) -> list[TruthCase]:
    """An effect beside a late column."""
    name = str(rng.choice(["steering_offset", "steering_gain", "wheel_slip", "antenna_right"]))
    late = {"position": ColumnClock(delay_s=float(rng.uniform(0.25, 0.4)))}
    ids = frozenset({name, "position_delay"})
    return [TruthCase("mixed", seed, {name: draw_effect(name, rng)}, late, programme="both", wanted=ids,
                      allowed=ids | {"clock_offset_position"})]  # fmt: skip


DRAWERS: dict[str, Callable[[Rng, int], list[TruthCase]]] = {
    "clean": draw_clean, "effect": draw_effects, "pair": draw_pairs, "closed_loop": draw_closed_loop,
    "column": draw_columns, "law": draw_laws, "fault": draw_faults, "outside": draw_outside, "odd_run": draw_odd_runs,
    "one_sided": draw_one_sided, "one_speed": draw_one_speed, "mixed": draw_mixed,
}  # fmt: skip


def draw_fifth_cases(seed: int, kinds: Collection[str] | None = None) -> list[TruthCase]:
    """All cases of a seed, or those of some kinds. Raises ValueError for an unknown kind."""
    wanted = KINDS if kinds is None else kinds
    unknown = sorted(set(wanted) - set(KINDS))
    if unknown:
        raise ValueError(f"The kind {unknown[0]!r} is unknown; use one of: {', '.join(KINDS)}.")
    cases = []
    for number, kind in enumerate(KINDS):
        if kind in wanted:
            cases += DRAWERS[kind](np.random.default_rng([seed, 57, number]), seed * 1000 + number * 50)
    return cases
