"""The cases of the fourth reference: about 45 a seed over all kinds, with sizes, signs, places and times drawn."""

from __future__ import annotations

import math
from collections.abc import Collection

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
)
from tests.truth.effects import NEUTRAL, Effects

OPEN_PROGRAMMES = ("three_speeds", "drawn")
ONE_SIDED = ("steering_gain", "antenna_right", "heading_bias", "steering_offset")
ONE_SPEED = ("understeer", "gnss_latency", "antenna_forward", "speed_lag")
PAIRS = (
    ("steering_offset", "heading_bias"), ("steering_gain", "gnss_latency"), ("steering_lag", "wheel_slip"),
    ("understeer", "steering_dead_time"), ("antenna_forward", "steering_asymmetry"), ("cross_slope_drift", "speed_lag"),
    ("steering_backlash", "implement_slip"), ("side_slip", "antenna_right"), ("grip_patch", "steering_rate"),
    ("implement_side_draft", "steering_deadband"), ("grip_drift", "antenna_forward"),
    ("steering_rate", "steering_gain"),
)  # fmt: skip
OUTSIDE: dict[str, Cause] = {
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


def choose_programme(rng: Rng) -> str:
    """One of the programmes in which people steer."""
    return str(rng.choice(OPEN_PROGRAMMES))


def draw_hidden(names: Collection[str], rng: Rng) -> Effects:
    """Effects in clear sizes."""
    return {str(name): draw_effect(str(name), rng) for name in names}


def draw_clean(rng: Rng, seed: int) -> list[TruthCase]:
    """Nothing hidden: two programmes, the autosteer's lines, and 5 Hz."""
    plan = (("three_speeds", 10.0), ("drawn", 10.0), ("lines", 10.0), ("drawn", 5.0))
    return [build_case("clean", seed + k, programme=name, rate_hz=rate) for k, (name, rate) in enumerate(plan)]


def draw_alone(rng: Rng, seed: int) -> list[TruthCase]:
    """Ten effects of the catalogue, each alone; two seeds in a row miss at most a few."""
    return [build_case("effect", seed + k, draw_hidden([name], rng), programme=choose_programme(rng))
            for k, name in enumerate(pick(NEUTRAL, 10, rng))]  # fmt: skip


def draw_pairs(rng: Rng, seed: int) -> list[TruthCase]:
    """Four pairs of effects of different blocks."""
    return [build_case("pair", seed + k, draw_hidden(names, rng), programme=choose_programme(rng))
            for k, names in enumerate(pick(PAIRS, 4, rng))]  # fmt: skip


def draw_closed_loop(rng: Rng, seed: int) -> list[TruthCase]:
    """Three effects while the autosteer holds lines."""
    names = ("steering_offset", "steering_gain", "steering_dead_time", "antenna_right", "heading_bias", "wheel_slip",
             "steering_backlash", "gnss_latency", "cross_slope_drift", "steering_rate")  # fmt: skip
    return [build_case("closed_loop", seed + k, draw_hidden([name], rng), programme="lines")
            for k, name in enumerate(pick(names, 3, rng))]  # fmt: skip


def draw_columns(rng: Rng, seed: int) -> list[TruthCase]:
    """Five clocks of columns of the ten here."""
    late, early = float(rng.uniform(0.25, 0.5)), -float(rng.uniform(0.25, 0.5))
    plan = (
        {"position": ColumnClock(delay_s=late)},
        {"heading": ColumnClock(delay_s=late)},
        {"heading": ColumnClock(filter_s=float(rng.uniform(0.5, 1.0)))},
        {"speed": ColumnClock(scale=float(rng.choice([0.92, 1.08])))},
        {"position": ColumnClock(offset_s=early)},
        {"heading": ColumnClock(offset_s=early)},
        {"steering": ColumnClock(delay_s=late)},
        {"steering": ColumnClock(hold_s=0.8, hold_jitter=0.2)},
        {"position": ColumnClock(hold_s=0.5), "heading": ColumnClock(hold_s=0.5)},
        {"speed": ColumnClock(delay_s=late + 0.2)},
    )
    return [build_case("column", seed + k, columns=columns, programme=choose_programme(rng))
            for k, columns in enumerate(pick(plan, 5, rng))]  # fmt: skip


def draw_laws(rng: Rng, seed: int) -> list[TruthCase]:
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
    also = {("steering_offset", "over_minutes"): ["grip_drift"], ("steering_gain", "by_place"): ["grip_patch"]}
    return [
        build_case("law", seed + k, laws=(law,), also=also.get((law.effect, law.kind), ()), words=LAW_WORDS[law.kind],
                   programme="drawn" if law.kind == "by_implement" else choose_programme(rng))
        for k, law in enumerate(pick(plan, 5, rng))
    ]  # fmt: skip


def draw_faults(rng: Rng, seed: int) -> list[TruthCase]:
    """Six faults, each beginning in one run of many; every other ends there too, the rest last to the end."""
    plan = [("steering_loose", {}), ("steering_stuck", {"side": float(rng.choice([-1.0, 1.0]))}),
            ("position_lost", {"mode": 0.0, "size_m": float(rng.uniform(0.8, 2.0))}),
            ("position_lost", {"mode": 1.0, "size_m": float(rng.uniform(1.0, 3.0))}),
            ("position_frozen", {}), ("heading_frozen", {}), ("speed_frozen", {}),
            ("wheel_sensor_frozen", {})]  # fmt: skip
    cases = []
    for k, (name, detail) in enumerate(pick(plan, 6, rng)):
        run = int(rng.integers(2, 6))  # runs with bends: what nobody uses cannot be seen to fail
        from_s = float(rng.uniform(14.0, 36.0))
        to_s = from_s + float(rng.uniform(10.0, 16.0)) if k % 2 else None
        cases.append(build_case("fault", seed + k, faults=(Fault(name, run, from_s, to_s, detail),),
                                programme="three_speeds" if k % 3 else "drawn"))  # fmt: skip
    return cases


def draw_outside(rng: Rng, seed: int) -> list[TruthCase]:
    """Six causes that the catalogue does not have."""
    cases = []
    for k, (name, (ranges, words, also)) in enumerate(pick(OUTSIDE.items(), 6, rng)):
        outside = {name: draw_ranges(ranges, rng)}
        programme = "drawn" if "implement" in words else choose_programme(rng)
        cases.append(build_case("outside", seed + k, outside=outside, programme=programme, also=also, words=words))
    return cases


def draw_odd_runs(rng: Rng, seed: int) -> list[TruthCase]:
    """One run unlike the others, which have nothing hidden, or an effect of their own."""
    less = Law("steering_gain", "by_run", {"run": float(rng.integers(2, 6)), "value": 0.82, "other": 1.0})
    bent = Law("steering_offset", "by_run", {"run": float(rng.integers(2, 6)), "value": float(rng.choice([-2.0, 2.0])),
                                             "other": 0.0})  # fmt: skip
    slow = {"steering_lag": draw_effect("steering_lag", rng)}
    return [
        build_case("odd_run", seed, laws=(less,), wanted=(), words=("run",)),
        build_case("odd_run", seed + 1, slow, laws=(bent,), wanted=slow, words=("run",), programme="drawn"),
    ]


def draw_mixed(rng: Rng, seed: int) -> list[TruthCase]:
    """A lawn tractor at 5 Hz, steering once written every 2 s (no dead time shows); an effect behind a late column."""
    gain = float(rng.choice([0.75, 1.3]))
    old = ColumnClock(hold_s=2.0, hold_jitter=0.1)
    lawn = {"steering_offset": {"angle_deg": float(rng.uniform(-2.1, -1.5))}, "steering_gain": {"ratio": gain},
            "steering_dead_time": {"time_s": float(rng.uniform(0.3, 0.4))}}  # fmt: skip
    name = str(rng.choice(["steering_offset", "steering_gain", "wheel_slip", "antenna_right"]))
    effects = {name: draw_effect(name, rng)}
    late = {"position": ColumnClock(delay_s=float(rng.uniform(0.25, 0.45)))}
    held, clear = {"steering": old, "steering_command": old}, ("steering_offset", "steering_gain")
    return [
        build_case("mixed", seed, lawn, columns=held, wanted=clear, programme="lawn", rate_hz=5.0),
        build_case("mixed", seed + 1, lawn, programme="lawn", rate_hz=5.0),
        build_case("mixed", seed + 2, effects, columns=late, programme="drawn"),
    ]


DRAWERS: Drawers = {
    "clean": draw_clean, "effect": draw_alone, "pair": draw_pairs, "closed_loop": draw_closed_loop,
    "column": draw_columns, "law": draw_laws, "fault": draw_faults, "outside": draw_outside, "odd_run": draw_odd_runs,
    # Bends to one side, or at one speed: clean, and with an effect that others can stand in for.
    "one_sided": lambda rng, seed: [
        build_case("one_sided", seed, programme="right_only"),
        build_case("one_sided", seed + 1, draw_one(ONE_SIDED, rng), programme="right_only"),
    ],
    "one_speed": lambda rng, seed: [build_case("one_speed", seed, draw_one(ONE_SPEED, rng), programme="one_speed")],
    "mixed": draw_mixed,
}  # fmt: skip


def draw_fourth_cases(seed: int, kinds: Collection[str] | None = None) -> list[TruthCase]:
    """All cases of a seed, or those of some kinds; each has its own seed. Raises ValueError for an unknown kind."""
    return draw_kinds(seed, kinds, DRAWERS, 44)
