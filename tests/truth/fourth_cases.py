"""The cases of the fourth reference: about 45 a seed over all kinds, with sizes, signs, places and times drawn."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection

import numpy as np

from tests.truth.cases import KINDS, ColumnClock, Fault, Law, TruthCase
from tests.truth.effects import CLEAR_SIZES, NEUTRAL, PLACES, Effects, scaled

EITHER_WAY = ("steering_offset", "steering_gain", "steering_asymmetry", "implement_side_draft", "antenna_forward",
              "antenna_right", "heading_bias", "grip_drift")  # fmt: skip
OPEN_PROGRAMMES = ("three_speeds", "drawn")
RUNS = {"three_speeds": 8, "drawn": 9, "lines": 8, "lawn": 7}
PAIRS = (
    ("steering_offset", "heading_bias"), ("steering_gain", "gnss_latency"), ("steering_lag", "wheel_slip"),
    ("understeer", "steering_dead_time"), ("antenna_forward", "steering_asymmetry"), ("cross_slope_drift", "speed_lag"),
    ("steering_backlash", "implement_slip"), ("side_slip", "antenna_right"), ("grip_patch", "steering_rate"),
    ("implement_side_draft", "steering_deadband"), ("grip_drift", "antenna_forward"),
    ("steering_rate", "steering_gain"),
)  # fmt: skip
OUTSIDE: dict[str, tuple[dict[str, tuple[float, float]], tuple[str, ...], tuple[str, ...]]] = {
    "tine_grip": ({"share": (0.4, 0.8)}, ("implement", "work"), ()),
    "loose_hitch": ({"play_m": (0.12, 0.25)}, ("implement", "work"), ()),
    "engine_droop": ({"share": (0.25, 0.45)}, ("steering", "speed"), ()),
    "soft_field": ({"share": (0.25, 0.4)}, ("place", "patch"), ()),
    "furrow_pull": ({"angle_deg": (1.2, 2.0)}, ("place", "position"), ()),
    "rear_steer": ({"ratio": (0.15, 0.3)}, ("angle", "steering"), ("steering_gain",)),
    "torque_steer": ({"deg_per_weight": (20.0, 40.0)}, ("speed", "acceleration", "start"), ()),
    "steering_hunt": ({"time_s": (0.16, 0.22)}, ("steering", "wheel", "command"),
                      ("steering_lag", "steering_dead_time")),
    "gyro_walk": ({"size_deg": (1.5, 3.0)}, ("heading", "time"), ()),
    "compass_deviation": ({"size_deg": (2.5, 5.0), "bearing_deg": (0.0, 360.0)},
                          ("heading", "direction", "bearing"), ()),
    "multipath": ({"size_m": (0.12, 0.3)}, ("place", "position"), ()),
    "antenna_sway": ({"m_per_mps2": (0.12, 0.25)}, ("lateral", "speed", "antenna", "turn"), ()),
    "base_drift": ({"size_m": (0.4, 0.9), "period_s": (30.0, 80.0)}, ("time", "position"), ()),
    "radar_threshold": ({"speed_mps": (0.9, 1.2)}, ("speed",), ("speed_scale",)),
    "articulated": ({"here": (1.0, 1.0)}, ("angle", "steering", "articulated", "place"), ()),
}  # fmt: skip
"""Cause: ranges of its numbers, words of which one should be in a hint, and ids that would be right all the same."""


def draw_effect(name: str, rng: np.random.Generator, least: float = 1.0) -> dict[str, float]:
    """An effect from `least` to 1.35 times its clear size, to either side where it has two, somewhere in the field."""
    values = scaled(name, float(rng.uniform(least, 1.35)))
    if name in EITHER_WAY and rng.random() < 0.5:
        values = {key: 2.0 * NEUTRAL[name][key] - value for key, value in values.items()}
    for key in values:
        if key == "bearing_deg":
            values[key] = float(rng.uniform(0.0, 360.0))
        elif key in ("east_m", "north_m"):
            values[key] = float(rng.uniform(-12.0, 12.0))
        elif key == "radius_m":
            values[key] = float(rng.uniform(9.0, 16.0))
    return values


def get_size_key(name: str) -> str:
    """The parameter of an effect that says how large it is."""
    return next(key for key in CLEAR_SIZES[name] if key not in PLACES)


def draw_fourth_cases(seed: int, kinds: Collection[str] | None = None) -> list[TruthCase]:
    """All cases of a seed, or those of some kinds; each has its own seed. Raises ValueError for an unknown kind."""
    wanted = KINDS if kinds is None else kinds
    unknown = sorted(set(wanted) - set(KINDS))
    if unknown:
        raise ValueError(f"The kind {unknown[0]!r} is unknown; use one of: {', '.join(KINDS)}.")
    cases = []
    for number, kind in enumerate(KINDS):
        rng = np.random.default_rng([seed, 44, number])
        drawn = DRAWERS[kind](rng, seed * 1000 + number * 50)
        cases += drawn if kind in wanted else []
    return cases


def draw_clean(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """Nothing hidden: two programmes, the autosteer's lines, and 5 Hz."""
    plan = (("three_speeds", 10.0), ("drawn", 10.0), ("lines", 10.0), ("drawn", 5.0))
    return [TruthCase("clean", seed + k, programme=name, rate_hz=rate) for k, (name, rate) in enumerate(plan)]


def draw_effects(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """Ten effects of the catalogue, each alone; two seeds in a row miss at most a few."""
    names = list(rng.permutation(list(NEUTRAL)))[:10]
    return [make_case("effect", seed + k, {name: draw_effect(name, rng)}, str(rng.choice(OPEN_PROGRAMMES)))
            for k, name in enumerate(names)]  # fmt: skip


def make_case(kind: str, seed: int, effects: Effects, programme: str) -> TruthCase:
    """A case of effects of the catalogue and nothing else."""
    ids = frozenset(effects)
    return TruthCase(kind, seed, effects, programme=programme, allowed=ids, wanted=ids)


def draw_pairs(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """Four pairs of effects of different blocks."""
    chosen = [PAIRS[k] for k in rng.permutation(len(PAIRS))[:4]]
    return [
        make_case("pair", seed + k, {name: draw_effect(name, rng) for name in names}, str(rng.choice(OPEN_PROGRAMMES)))
        for k, names in enumerate(chosen)
    ]


def draw_closed_loop(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """Three effects while the autosteer holds lines."""
    names = ("steering_offset", "steering_gain", "steering_dead_time", "antenna_right", "heading_bias", "wheel_slip",
             "steering_backlash", "gnss_latency", "cross_slope_drift", "steering_rate")  # fmt: skip
    chosen = [names[k] for k in rng.permutation(len(names))[:3]]
    return [
        make_case("closed_loop", seed + k, {name: draw_effect(name, rng)}, "lines") for k, name in enumerate(chosen)
    ]


def draw_columns(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """Five clocks of columns of the nine here."""
    late, early = float(rng.uniform(0.25, 0.5)), -float(rng.uniform(0.25, 0.5))
    plan: list[tuple[dict[str, ColumnClock], set[str], set[str]]] = [
        ({"position": ColumnClock(delay_s=late)}, {"position_delay"}, {"clock_offset_position"}),
        ({"heading": ColumnClock(delay_s=late)}, {"heading_delay"}, {"clock_offset_heading"}),
        ({"heading": ColumnClock(filter_s=float(rng.uniform(0.5, 1.0)))}, {"heading_filter"}, {"heading_delay"}),
        ({"speed": ColumnClock(scale=float(rng.choice([0.92, 1.08])))}, {"speed_scale"}, set()),
        ({"position": ColumnClock(offset_s=early)}, {"clock_offset_position"}, set()),
        ({"heading": ColumnClock(offset_s=early)}, {"clock_offset_heading"}, set()),
        ({"steering": ColumnClock(delay_s=late)}, set(), {"clock_offset_steering"}),
        ({"steering": ColumnClock(hold_s=0.8, hold_jitter=0.2)}, set(), set()),
        ({"position": ColumnClock(hold_s=0.5), "heading": ColumnClock(hold_s=0.5)}, set(), set()),
        ({"speed": ColumnClock(delay_s=late + 0.2)}, set(), {"clock_offset_speed"}),
    ]  # fmt: skip
    cases = []
    for k, place in enumerate(rng.permutation(len(plan))[:5]):
        columns, want, also = plan[place]
        cases.append(TruthCase("column", seed + k, columns=columns, programme=str(rng.choice(OPEN_PROGRAMMES)),
                               allowed=frozenset(want | also), wanted=frozenset(want)))  # fmt: skip
    return cases


def draw_laws(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """Five laws of the eleven here."""
    sign, way = float(rng.choice([-1.0, 1.0])), float(rng.uniform(0.0, 2.0 * math.pi))
    steep, phase = float(rng.uniform(0.012, 0.02)), float(rng.uniform(0.0, 360.0))
    plan = [
        Law("steering_offset", "over_minutes", {"start": 0.0, "per_minute": 2.2 * sign}),
        Law("steering_gain", "over_day", {"mean": 1.0, "amplitude": 0.14, "period_s": 7200.0, "phase_deg": phase}),
        Law("steering_gain", "by_place", {"at_origin": 1.0, "per_m_east": steep * math.sin(way),
                                          "per_m_north": steep * math.cos(way)}),
        Law("steering_rate", "by_side", {"left": 8.0 + 10.0 * (sign > 0), "right": 8.0 + 10.0 * (sign < 0)}),
        Law("steering_deadband", "by_side", {"left": 0.2 + 1.5 * (sign > 0), "right": 0.2 + 1.5 * (sign < 0)}),
        Law("steering_gain", "by_angle", {"at_0": 1.0 - 0.13 * sign, "at_27": 1.0 + 0.16 * sign}),
        Law("steering_offset", "by_speed", {"at_0": 0.0, "per_mps": 0.9 * sign}),
        Law("steering_gain", "by_implement", {"lifted": 1.0, "working": 0.8}),
        Law("steering_dead_time", "by_speed", {"at_0": 0.5, "per_mps": -0.15}),
        Law("heading_bias", "over_day", {"mean": 0.0, "amplitude": 2.5, "period_s": 6000.0, "phase_deg": phase}),
        Law("wheel_slip", "by_place", {"at_origin": 0.05, "per_m_east": 0.003 * math.sin(way),
                                       "per_m_north": 0.003 * math.cos(way)}),
    ]  # fmt: skip
    words = {"over_minutes": ("time", "minute"), "over_day": ("day", "time", "run"),
             "by_place": ("place", "east", "north"),
             "by_side": ("side", "left", "right"), "by_angle": ("angle",), "by_speed": ("speed",),
             "by_implement": ("implement", "work")}  # fmt: skip
    also = {("steering_offset", "over_minutes"): {"grip_drift"}, ("steering_gain", "by_place"): {"grip_patch"}}
    cases = []
    for k, place in enumerate(rng.permutation(len(plan))[:5]):
        law = plan[place]
        ids = frozenset({law.effect}) | also.get((law.effect, law.kind), set())
        cases.append(TruthCase("law", seed + k, laws=(law,), programme="drawn" if law.kind == "by_implement" else
                               str(rng.choice(OPEN_PROGRAMMES)), allowed=ids, wanted=frozenset({law.effect}),
                               hint_words=words[law.kind]))  # fmt: skip
    return cases


def draw_faults(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """Six faults, each beginning in one run of many; every other ends there too, the rest last to the end."""
    plan = [("steering_loose", {}), ("steering_stuck", {"side": float(rng.choice([-1.0, 1.0]))}),
            ("position_lost", {"mode": 0.0, "size_m": float(rng.uniform(0.8, 2.0))}),
            ("position_lost", {"mode": 1.0, "size_m": float(rng.uniform(1.0, 3.0))}),
            ("position_frozen", {}), ("heading_frozen", {}), ("speed_frozen", {}),
            ("wheel_sensor_frozen", {})]  # fmt: skip
    cases = []
    for k, place in enumerate(rng.permutation(len(plan))[:6]):
        name, detail = plan[place]
        programme = "three_speeds" if k % 3 else "drawn"
        run = int(rng.integers(2, 6))  # runs with bends: what nobody uses cannot be seen to fail
        from_s = float(rng.uniform(14.0, 36.0))
        to_s = from_s + float(rng.uniform(10.0, 16.0)) if k % 2 else None
        cases.append(TruthCase("fault", seed + k, faults=(Fault(name, run, from_s, to_s, detail),), programme=programme,
                               allowed=frozenset({name}), wanted=frozenset({name})))  # fmt: skip
    return cases


def draw_outside(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """Six causes that the catalogue does not have."""
    cases = []
    for k, place in enumerate(rng.permutation(len(OUTSIDE))[:6]):
        name = list(OUTSIDE)[place]
        ranges, words, allowed = OUTSIDE[name]
        values = {key: float(rng.uniform(low, high)) for key, (low, high) in ranges.items()}
        programme = "drawn" if "implement" in words else str(rng.choice(OPEN_PROGRAMMES))
        cases.append(TruthCase("outside", seed + k, outside={name: values}, programme=programme,
                               allowed=frozenset(allowed), hint_words=words))  # fmt: skip
    return cases


def draw_odd_runs(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """One run unlike the others, which have nothing hidden, or an effect of their own."""
    less = Law("steering_gain", "by_run", {"run": float(rng.integers(2, 6)), "value": 0.82, "other": 1.0})
    bent = Law("steering_offset", "by_run", {"run": float(rng.integers(2, 6)), "value": float(rng.choice([-2.0, 2.0])),
                                             "other": 0.0})  # fmt: skip
    slow = {"steering_lag": draw_effect("steering_lag", rng)}
    return [
        TruthCase("odd_run", seed, laws=(less,), allowed=frozenset({"steering_gain"}), hint_words=("run",)),
        TruthCase("odd_run", seed + 1, slow, laws=(bent,), programme="drawn", hint_words=("run",),
                  allowed=frozenset({"steering_lag", "steering_offset"}), wanted=frozenset(slow)),
    ]  # fmt: skip


def draw_one_sided(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """Bends to one side only: clean, and with an effect that others can stand in for."""
    name = str(rng.choice(["steering_gain", "antenna_right", "heading_bias", "steering_offset"]))
    return [TruthCase("one_sided", seed, programme="right_only"),
            make_case("one_sided", seed + 1, {name: draw_effect(name, rng)}, "right_only")]  # fmt: skip


def draw_one_speed(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """One speed only, at which understeer is a gain and latency is a lever."""
    name = str(rng.choice(["understeer", "gnss_latency", "antenna_forward", "speed_lag"]))
    return [make_case("one_speed", seed, {name: draw_effect(name, rng)}, "one_speed")]


def draw_mixed(rng: np.random.Generator, seed: int) -> list[TruthCase]:
    """A lawn tractor at 5 Hz, steering once written every 2 s (no dead time shows); an effect behind a late column."""
    gain = float(rng.choice([0.75, 1.3]))
    old = ColumnClock(hold_s=2.0, hold_jitter=0.1)
    lawn = {"steering_offset": {"angle_deg": float(rng.uniform(-2.1, -1.5))}, "steering_gain": {"ratio": gain},
            "steering_dead_time": {"time_s": float(rng.uniform(0.3, 0.4))}}  # fmt: skip
    name = str(rng.choice(["steering_offset", "steering_gain", "wheel_slip", "antenna_right"]))
    effects = {name: draw_effect(name, rng)}
    late = {"position": ColumnClock(delay_s=float(rng.uniform(0.25, 0.45)))}
    return [
        TruthCase("mixed", seed, lawn, {"steering": old, "steering_command": old}, programme="lawn", rate_hz=5.0,
                  allowed=frozenset(lawn), wanted=frozenset({"steering_offset", "steering_gain"})),
        TruthCase("mixed", seed + 1, lawn, programme="lawn", rate_hz=5.0, allowed=frozenset(lawn),
                  wanted=frozenset(lawn)),
        TruthCase("mixed", seed + 2, effects, late, programme="drawn", wanted=frozenset({name, "position_delay"}),
                  allowed=frozenset({name, "position_delay", "clock_offset_position"})),
    ]  # fmt: skip


DRAWERS: dict[str, Callable[[np.random.Generator, int], list[TruthCase]]] = {
    "clean": draw_clean, "effect": draw_effects, "pair": draw_pairs, "closed_loop": draw_closed_loop,
    "column": draw_columns, "law": draw_laws, "fault": draw_faults, "outside": draw_outside, "odd_run": draw_odd_runs,
    "one_sided": draw_one_sided, "one_speed": draw_one_speed, "mixed": draw_mixed,
}  # fmt: skip
