"""How the third reference draws its cases: kinds, sizes, signs, places and times by the seed, from the tables here."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from tests.truth.cases import KINDS, ColumnClock, Fault, Law, TruthCase
from tests.truth.effects import NEUTRAL, Effects, scaled

Rng = np.random.Generator

EITHER_WAY = ("steering_offset", "steering_gain", "steering_asymmetry", "implement_side_draft", "antenna_forward",
              "antenna_right", "heading_bias", "grip_drift")  # fmt: skip
CLEAR_SHARE, PATCH_AT_M, PATCH_RADIUS_M, DAY_S = (1.0, 1.35), (-12.0, 12.0), (9.0, 16.0), 1400.0
CLOSED = (
    "steering_offset", "steering_gain", "steering_dead_time", "steering_lag", "steering_rate", "steering_deadband",
    "steering_backlash", "antenna_right", "antenna_forward", "gnss_latency", "wheel_slip", "implement_slip",
    "cross_slope_drift", "implement_side_draft", "heading_bias",
)  # fmt: skip
ONE_SIDED = ("steering_gain", "antenna_right", "heading_bias", "steering_offset")
ONE_SPEED = ("understeer", "gnss_latency", "antenna_forward", "speed_lag")
BEHIND_A_LATE_COLUMN = ("steering_offset", "steering_gain", "wheel_slip", "antenna_right")
PAIRS = (
    ("steering_offset", "antenna_right"), ("steering_gain", "wheel_slip"), ("antenna_forward", "speed_lag"),
    ("steering_dead_time", "implement_slip"), ("steering_asymmetry", "heading_bias"), ("steering_rate", "understeer"),
    ("steering_backlash", "gnss_latency"), ("cross_slope_drift", "steering_gain"), ("grip_patch", "steering_deadband"),
    ("implement_side_draft", "steering_lag"), ("side_slip", "antenna_right"), ("grip_drift", "antenna_forward"),
)  # fmt: skip


class Either(NamedTuple):
    """A number so far to either side of a middle."""

    low: float
    high: float
    middle: float = 0.0


Row = TypeVar("Row")
Number = float | tuple[float, float] | Either
"""A number of a table: as it is, from a range, or to either side."""
Numbers = Mapping[str, Number]


class Cause(NamedTuple):
    """A cause outside the catalogue: its numbers, words of which one should be in a hint, ids that are as right."""

    values: Numbers
    words: tuple[str, ...]
    also: tuple[str, ...] = ()


COUNTS = {"clean": 4, "effect": 9, "pair": 2, "closed_loop": 3, "column": 4, "law": 4, "fault": 4, "outside": 5,
          "odd_run": 2, "one_sided": 2, "one_speed": 2, "mixed": 1}  # fmt: skip
"""Cases of each kind."""
PROGRAMMES: Mapping[str, tuple[str, ...]] = {
    "clean": ("three_speeds", "mixed", "closed"), "closed_loop": ("closed",), "one_sided": ("one_sided",),
    "one_speed": ("one_speed", "ordered_angles"), "mixed": ("mixed",),
}  # fmt: skip
"""Of each kind of case; all others have three_speeds."""
RATES_HZ = (5.0, 10.0, 10.0, 20.0)
PLACE, TIME = ("place", "position", "north", "east", "field"), ("time", "day", "minute", "later", "run")
WAYS = ("bearing", "heading", "direction", "north", "east")
IMPLEMENT, SWING = ("implement", "work"), ("period", "swing", "every", "wave")
BEARING_DEG = (0.0, 360.0)
OUTSIDE: Mapping[str, Cause] = {
    "oil_temperature": Cause({"lag_s": 0.6, "rate_share": 0.5, "warm_s": 350.0}, TIME,
                             ("steering_lag", "steering_rate", "steering_dead_time")),
    "tyre_pressure_loss": Cause({"run": (2.0, 4.99), "per_minute": (0.8, 1.2)}, TIME),
    "crosswind": Cause({"mps2": (0.5, 0.9), "bearing_deg": BEARING_DEG}, WAYS, ("cross_slope_drift",)),
    "gravity_slope": Cause({"mps2": (0.5, 0.9), "bearing_deg": BEARING_DEG}, WAYS, ("cross_slope_drift",)),
    "speed_linkage": Cause({"deg_per_mps": (1.0, 1.5)}, ("speed",)),
    "implement_push": Cause({"side_n": (2000.0, 3000.0)}, IMPLEMENT, ("implement_side_draft",)),
    "wheel_wobble": Cause({"angle_deg": (1.5, 2.2), "length_m": (2.0, 4.0)}, SWING),
    "hitch_swing": Cause({"side_n": (4000.0, 7000.0)}, (*SWING, "implement", "bend")),
    "differential_lock": Cause({"share": 1.0, "from_s": 20.0}, ("time", "angle", "bend", "later")),
    "moist_soil": Cause({"share": (0.15, 0.25), "east_m": Either(5.0, 10.0), "north_m": Either(5.0, 10.0),
                         "radius_m": 14.0}, PLACE, ("grip_patch",)),
    "steering_stiction": Cause({"angle_deg": (1.2, 1.8)}, ("steering", "command", "small"),
                               ("steering_deadband", "steering_backlash")),
    "trees": Cause({"size_m": (0.5, 0.9), "east_m": (-4.0, 4.0), "width_m": 5.0}, (*PLACE, "receiver")),
    "brisk_start": Cause({"mps2": (1.3, 1.8)}, ("start", "speed")),
    "soft_front_tyres": Cause({"share": (0.22, 0.27)}, ("lateral", "speed", "bend"), ("understeer",)),
    "articulated": Cause({"joint": (0.4, 0.6), "antenna_forward_m": (-0.8, 0.2)},
                         ("steering", "rate", "antenna", "articulated")),
    "mast_sway": Cause({"m_per_mps2": (0.25, 0.4)}, ("antenna", "position", "lateral")),
    "governor_hunting": Cause({"share": (0.06, 0.1), "period_s": (3.0, 5.0)}, ("speed", "period")),
}  # fmt: skip
"""Causes outside the catalogue, described where they act: tests.truth.third_outside."""
FAULT_RUNS: Mapping[str, tuple[str, tuple[int, ...]]] = {
    "loose": ("mixed", (2, 4)),
    "torn": ("three_speeds", (2, 3, 4)),
    "stuck": ("three_speeds", (0, 1, 2, 3, 4)),
    "wanders": ("three_speeds", tuple(range(8))),
    "jumps": ("mixed", tuple(range(8))),
    "position_frozen": ("mixed", tuple(range(8))),
    "heading_frozen": ("three_speeds", (2, 3, 4)),
    "speed_frozen": ("three_speeds", tuple(range(8))),
    "wheel_sensor_frozen": ("mixed", (2, 4)),
}
"""The programme and the runs in which each of FAULTS shows at once."""
BEND_RUNS = (2, 3, 4)  # with bends
COLUMN_PLANS: tuple[tuple[dict[str, Numbers], tuple[str, ...]], ...] = (
    ({"position": {"delay_s": (0.25, 0.45)}}, ()),
    ({"heading": {"delay_s": (0.25, 0.45)}}, ()),
    ({"heading": {"filter_s": (0.5, 0.8)}}, ()),
    ({"speed": {"scale": Either(0.06, 0.08, 1.0)}}, ()),
    ({"speed": {"delay_s": (0.45, 0.7)}}, ()),
    ({"steering": {"scale": (0.88, 0.92)}}, ()),
    ({"steering": {"offset_s": (0.3, 0.5)}}, ()),
    ({"steering": {"hold_s": 1.0, "hold_jitter": 0.1}}, ()),
    ({"steering": {"hold_s": 2.0, "hold_jitter": 0.05}, "steering_command": {"hold_s": 2.0, "hold_jitter": 0.05}}, ()),
    ({"steering_command": {"offset_s": Either(0.25, 0.5)}}, ("steering_dead_time",)),
    ({"position": {"offset_s": (-0.45, -0.25)}}, ()),
    ({"heading": {"offset_s": (-0.45, -0.25)}}, ()),
    ({"position": {"drift_s_per_min": Either(0.3, 0.5)}}, ()),
    ({"position": {"hold_s": 0.8}}, ("position_delay",)),
)
"""Clocks of columns, and ids that are as right."""
LAW_PLANS: tuple[tuple[str, str, Numbers, tuple[str, ...]], ...] = (
    ("steering_offset", "over_minutes", {"start": 0.0, "per_minute": Either(1.6, 2.2)}, ("grip_drift",)),
    ("steering_offset", "by_implement", {"lifted": 0.0, "working": Either(1.2, 1.8)}, ("implement_side_draft",)),
    ("steering_offset", "by_speed", {"at_0": 0.0, "per_mps": Either(0.8, 1.0)}, ()),
    ("steering_gain", "by_implement", {"lifted": 1.0, "working": (0.8, 0.85)}, ("implement_side_draft",)),
    ("steering_gain", "by_place", {"at_origin": 1.0, "per_m_north": Either(0.006, 0.012)}, ("grip_patch",)),
    ("steering_gain", "by_angle", {"at_0": 0.88, "at_27": (1.14, 1.2)}, ()),
    ("steering_gain", "over_day", {"mean": 1.0, "amplitude": (0.12, 0.15), "phase_deg": (0.0, 360.0)}, ()),
    ("steering_gain", "by_speed", {"at_0": 1.2, "per_mps": (-0.14, -0.1)}, ()),
    ("steering_rate", "by_side", {"left": (8.0, 9.0), "right": 18.0}, ()),
    ("steering_deadband", "by_side", {"left": 0.2, "right": (1.5, 1.8)}, ()),
    ("steering_dead_time", "by_speed", {"at_0": 0.5, "per_mps": -0.15}, ()),
    ("steering_lag", "over_minutes", {"start": 0.6, "per_minute": -0.45}, ()),
    ("heading_bias", "over_day", {"mean": 0.0, "amplitude": (1.8, 2.5), "phase_deg": (0.0, 360.0)}, ()),
    ("wheel_slip", "by_place", {"at_origin": 0.05, "per_m_north": Either(0.0015, 0.003)}, ()),
    ("wheel_slip", "by_speed", {"at_0": 0.01, "per_mps": (0.05, 0.07)}, ()),
    ("cross_slope_drift", "by_implement", {"lifted": 0.0, "working": (0.03, 0.045)}, ()),
)  # fmt: skip
"""Effect, kind, values, and ids that are as right."""
FAULTS: Mapping[str, tuple[str, Numbers]] = {
    "loose": ("steering_loose", {}), "torn": ("steering_loose", {"linkage": 1.0}),
    "stuck": ("steering_stuck", {"side": Either(1.0, 1.0)}),
    "wanders": ("position_lost", {"mode": 0.0, "size_m": (1.0, 2.2)}),
    "jumps": ("position_lost", {"mode": 1.0, "size_m": (1.2, 3.5)}),
    **{name: (name, {}) for name in ("position_frozen", "heading_frozen", "speed_frozen", "wheel_sensor_frozen")},
}  # fmt: skip
ODD_RUNS: tuple[tuple[str, Number, float], ...] = (
    ("steering_gain", (0.8, 0.86), 1.0), ("steering_offset", Either(1.4, 2.0), 0.0),
    ("steering_lag", (0.4, 0.6), 0.1), ("wheel_slip", (0.09, 0.12), 0.0),
)  # fmt: skip
"""Effect, its value in one run, and in all others."""


def choose_case(kind: str, rng: Rng, effects: Effects | None = None, **fields: Any) -> TruthCase:
    """A case in a programme of its kind at one of the rates."""
    names = PROGRAMMES.get(kind, ("three_speeds",))
    chosen = {"programme": str(rng.choice(names)), "rate_hz": float(rng.choice(RATES_HZ))}
    return build_case(kind, 0, effects, **chosen | fields)


def build_case(
    kind: str, seed: int, effects: Effects | None = None, *, columns: Mapping[str, ColumnClock] | None = None,
    laws: Sequence[Law] = (), faults: Sequence[Fault] = (), also: Iterable[str] = (),
    wanted: Iterable[str] | None = None, words: tuple[str, ...] = (), **fields: Any,
) -> TruthCase:  # fmt: skip
    """A case in which all that it hides may be named and is wanted, unless `wanted` says what is, and `also` may be."""
    clocks, alike = judge_clocks(columns or {})
    ids = {*(effects or {}), *(law.effect for law in laws), *(fault.id for fault in faults), *clocks}
    return TruthCase(
        kind, seed, effects or {}, columns or {}, tuple(laws), tuple(faults), hint_words=words,
        allowed=frozenset({*ids, *alike, *also}), wanted=frozenset(ids if wanted is None else wanted), **fields,
    )  # fmt: skip


def judge_clocks(columns: Mapping[str, ColumnClock]) -> tuple[set[str], set[str]]:
    """Ids that name the clocks of columns, and ids that would be as right."""
    ids: set[str] = set()
    alike: set[str] = set()
    for name, clock in columns.items():
        if clock.delay_s:
            alike.add(f"clock_offset_{name}")
            ids |= {f"{name}_delay"} & {"position_delay", "heading_delay"}
        if clock.filter_s:
            ids, alike = ids | {"heading_filter"}, alike | {"heading_delay"}
        if clock.scale != 1.0 and name == "speed":
            ids.add("speed_scale")
        if clock.offset_s or clock.drift_s_per_min:
            ids.add(f"clock_offset_{name}")
    return ids, alike


def pick(table: Iterable[Row], count: int, rng: Rng) -> list[Row]:
    """Rows of a table in a drawn order."""
    rows = list(table)
    return [rows[place] for place in rng.permutation(len(rows))[:count]]


def draw_numbers(numbers: Numbers, rng: Rng) -> dict[str, float]:
    """A value of each number; runs have whole ones."""
    values = {key: draw_number(number, rng) for key, number in numbers.items()}
    return {key: float(int(value)) if key == "run" else value for key, value in values.items()}


def draw_number(number: Number, rng: Rng) -> float:
    """A value of a number."""
    if isinstance(number, Either):
        return number.middle + float(rng.choice([-1.0, 1.0]) * rng.uniform(number.low, number.high))
    return float(rng.uniform(*number)) if isinstance(number, tuple) else number


def draw_effects(names: Iterable[str], rng: Rng) -> Effects:
    """Effects of about their clear size, to either side where they have two, somewhere in the field."""
    places = {"bearing_deg": (0.0, 360.0), "east_m": PATCH_AT_M, "north_m": PATCH_AT_M, "radius_m": PATCH_RADIUS_M}
    effects = {}
    for name in names:
        values = scaled(name, float(rng.uniform(*CLEAR_SHARE)))
        if name in EITHER_WAY and rng.random() < 0.5:
            values = {key: 2.0 * NEUTRAL[name][key] - value for key, value in values.items()}
        effects[name] = draw_numbers({key: places.get(key, value) for key, value in values.items()}, rng)
    return effects


# --- kinds ---------------------------------------------------------------------------------------------------------


def draw_columns(rng: Rng) -> list[TruthCase]:
    """Columns that are late, held, filtered, scaled or stamped by another clock."""
    return [
        choose_case("column", rng, also=also, columns={
            name: ColumnClock(**draw_numbers(clock, rng)) for name, clock in clocks.items()})
        for clocks, also in pick(COLUMN_PLANS, COUNTS["column"], rng)
    ]  # fmt: skip


def draw_laws(rng: Rng) -> list[TruthCase]:
    """Parameters that depend on time, place, implement, side, angle or speed."""
    cases = []
    for name, kind, values, also in pick(LAW_PLANS, COUNTS["law"], rng):
        effects = {name: {"bearing_deg": float(rng.uniform(0.0, 360.0))}} if name == "cross_slope_drift" else {}
        period = {"period_s": DAY_S} if kind == "over_day" else {}
        law = Law(name, kind, draw_numbers(values, rng) | period)
        cases.append(choose_case("law", rng, effects, laws=(law,), also=also))
    return cases


def draw_faults(rng: Rng) -> list[TruthCase]:
    """Things that break in one run in which they are used: some heal, some last to the end."""
    cases = []
    for place, name in enumerate(pick(FAULT_RUNS, COUNTS["fault"], rng)):
        (programme, runs), (fault_id, detail) = FAULT_RUNS[name], FAULTS[name]
        from_s = float(rng.uniform(15.0, 28.0))
        to_s = from_s + float(rng.uniform(12.0, 16.0)) if place % 2 else None
        fault = Fault(fault_id, int(rng.choice(runs)), from_s, to_s, draw_numbers(detail, rng))
        cases.append(choose_case("fault", rng, faults=(fault,), programme=programme))
    return cases


def draw_outside_case(name: str, rng: Rng) -> TruthCase:
    """A cause outside the catalogue."""
    cause = OUTSIDE[name]
    return choose_case("outside", rng, outside={name: draw_numbers(cause.values, rng)}, wanted=(), also=cause.also,
                       words=cause.words)  # fmt: skip


def draw_odd_runs(rng: Rng) -> list[TruthCase]:
    """One run with another tractor's values."""
    return [
        choose_case("odd_run", rng, wanted=(), words=("run",), laws=(Law(name, "by_run", {
            "run": float(rng.choice(BEND_RUNS)), "value": draw_number(value, rng), "other": other}),))
        for name, value, other in pick(ODD_RUNS, COUNTS["odd_run"], rng)
    ]  # fmt: skip


DRAWERS: Mapping[str, Callable[[Rng], list[TruthCase]]] = {
    "clean": lambda rng: [choose_case("clean", rng) for _ in range(COUNTS["clean"])],
    "effect": lambda rng: [choose_case("effect", rng, draw_effects([name], rng))
                           for name in pick(NEUTRAL, COUNTS["effect"], rng)],
    "pair": lambda rng: [choose_case("pair", rng, draw_effects(names, rng))
                               for names in pick(PAIRS, COUNTS["pair"], rng)],
    "closed_loop": lambda rng: [choose_case("closed_loop", rng, draw_effects([name], rng))
                                      for name in pick(CLOSED, COUNTS["closed_loop"], rng)],
    "column": draw_columns, "law": draw_laws, "fault": draw_faults, "odd_run": draw_odd_runs,
    "outside": lambda rng: [draw_outside_case(name, rng)
                                  for name in pick(OUTSIDE, COUNTS["outside"], rng)],
    # Bends to one side, or one speed: clean, and with an effect that others can stand in for.
    "one_sided": lambda rng: [choose_case("one_sided", rng),
                                    choose_case("one_sided", rng, draw_effects(pick(ONE_SIDED, 1, rng), rng))],
    "one_speed": lambda rng: [choose_case("one_speed", rng),
                                    choose_case("one_speed", rng, draw_effects(pick(ONE_SPEED, 1, rng), rng))],
    "mixed": lambda rng: [
        choose_case("mixed", rng, draw_effects(pick(BEHIND_A_LATE_COLUMN, 1, rng), rng),
                   columns={"position": ColumnClock(delay_s=float(rng.uniform(0.25, 0.4)))})],
}  # fmt: skip


def draw_cases(seed: int) -> list[TruthCase]:
    """The cases of a seed; each kind has draws of its own, each case a seed of its own."""
    cases = []
    for number, kind in enumerate(KINDS):
        drawn = DRAWERS[kind](np.random.default_rng([seed, 41, number]))
        cases += [replace(case, seed=seed * 1000 + number * 50 + place) for place, case in enumerate(drawn)]
    return cases
