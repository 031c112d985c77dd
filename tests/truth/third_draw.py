"""Cases of the third reference, drawn from a seed: what is hidden, how large, where, and what may be said of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from tests.truth.cases import KINDS, ColumnClock, Fault, Law, TruthCase
from tests.truth.drawing import Rng, build_case, check_kinds, pick, pick_names
from tests.truth.effects import CLEAR_SIZES, scaled

Draw = Callable[[Rng], list[TruthCase]]
SMALLEST, LARGEST = 1.0, 1.25  # shares of the clear size
SIGNED = (
    "steering_offset", "implement_side_draft", "antenna_forward", "antenna_right", "heading_bias", "grip_drift",
)  # fmt: skip
EITHER_WAY = ("steering_gain", "steering_asymmetry")  # below 1 as well as above it
SIDE = ("left", "right", "side")
PLACE = ("place", "north", "east", "field")
TIME = ("time", "day", "minute", "later", "run")
PAIRS = (
    ("steering_offset", "antenna_right"), ("steering_gain", "steering_rate"), ("antenna_forward", "speed_lag"),
    ("steering_dead_time", "wheel_slip"), ("steering_asymmetry", "heading_bias"), ("steering_backlash", "gnss_latency"),
    ("understeer", "steering_offset"), ("cross_slope_drift", "steering_gain"), ("grip_patch", "steering_deadband"),
    ("implement_side_draft", "steering_lag"),
)  # fmt: skip
CLOSED_EFFECTS = (
    "steering_offset", "steering_gain", "steering_dead_time", "steering_lag", "antenna_right", "antenna_forward",
    "gnss_latency", "wheel_slip", "cross_slope_drift", "implement_side_draft", "heading_bias", "steering_deadband",
)  # fmt: skip


def draw_size(name: str, rng: Rng) -> dict[str, float]:
    """Fresh parameters of an effect: 1.0 to 1.25 of the clear size, either sign where it has one, any place."""
    values = scaled(name, rng.uniform(SMALLEST, LARGEST))
    key, side = next(iter(values)), rng.choice([-1.0, 1.0])
    if name in SIGNED:
        values[key] *= side
    if name in EITHER_WAY and side < 0.0:
        values[key] = 2.0 - values[key]
    if name == "cross_slope_drift":
        values["bearing_deg"] = rng.uniform(0.0, 360.0)
    if name == "grip_patch":
        turn = rng.uniform(0.0, 2.0 * np.pi)
        values |= {"east_m": 13.0 * np.cos(turn), "north_m": 13.0 * np.sin(turn), "radius_m": rng.uniform(12.0, 16.0)}
    return {name: float(value) for name, value in values.items()}


def draw_seed(rng: Rng) -> int:
    """A seed for the draws of a case."""
    return int(rng.integers(1, 2**31))


def hide_effects(kind: str, names: Iterable[str], rng: Rng, programme: str = "three_speeds") -> TruthCase:
    """A case that hides effects of the catalogue in clear sizes."""
    hidden = {name: draw_size(name, rng) for name in names}
    return build_case(kind, draw_seed(rng), hidden, programme=programme)


def draw_clean(rng: Rng) -> list[TruthCase]:
    """Nothing hidden, in several programmes, rates and instruments as they come."""
    programmes = rng.permutation(["three_speeds", "mixed", "closed", "three_speeds"])
    return [TruthCase("clean", draw_seed(rng), programme=str(programme), rate_hz=rate_hz)
            for programme, rate_hz in zip(programmes, (10.0, 5.0, 20.0, 10.0), strict=True)]  # fmt: skip


def draw_effects(rng: Rng) -> list[TruthCase]:
    """One effect of the catalogue each."""
    return [hide_effects("effect", (name,), rng) for name in pick_names(sorted(CLEAR_SIZES), 9, rng)]


def draw_pairs(rng: Rng) -> list[TruthCase]:
    """Two effects at once."""
    return [hide_effects("pair", names, rng) for names in pick(PAIRS, 2, rng)]


def draw_closed(rng: Rng) -> list[TruthCase]:
    """One effect with a path follower in the loop all the time."""
    return [hide_effects("closed_loop", (name,), rng, "closed") for name in pick_names(CLOSED_EFFECTS, 3, rng)]


def draw_columns(rng: Rng) -> list[TruthCase]:
    """One column that is late, held, filtered, scaled or stamped by another clock."""
    side = rng.choice([-1.0, 1.0])
    held = ColumnClock(hold_s=2.0, hold_jitter=0.05)
    table: list[tuple[dict[str, ColumnClock], tuple[str, ...]]] = [
        ({"position": ColumnClock(delay_s=rng.uniform(0.2, 0.35))}, ("position",)),
        ({"heading": ColumnClock(delay_s=rng.uniform(0.2, 0.4))}, ("heading",)),
        ({"heading": ColumnClock(filter_s=rng.uniform(0.4, 0.7))}, ("heading",)),
        ({"speed": ColumnClock(scale=1.0 + side * rng.uniform(0.05, 0.08))}, ("speed",)),
        ({"steering": ColumnClock(scale=1.0 - rng.uniform(0.08, 0.12))}, ("wheel sensor", "steering_deg")),
        ({"steering_command": ColumnClock(offset_s=side * rng.uniform(0.25, 0.5))}, ("command", "clock")),
        ({"position": ColumnClock(offset_s=-rng.uniform(0.2, 0.4))}, ("position", "clock")),
        ({"steering": held, "steering_command": held}, ("steering", "held", "stale")),
        ({"position": ColumnClock(hold_s=1.0, delay_s=0.2)}, ("position",)),
        ({"steering": ColumnClock(offset_s=rng.uniform(0.3, 0.5))}, ("steering", "clock")),
        ({"position": ColumnClock(drift_s_per_min=side * rng.uniform(0.3, 0.5))}, ("position", "clock")),
    ]
    return [build_case("column", draw_seed(rng), columns=clocks, words=words)
            for clocks, words in pick(table, 4, rng)]  # fmt: skip


def draw_laws(rng: Rng) -> list[TruthCase]:
    """A parameter that depends on time, place, run, implement, side, angle or speed; or a driveline a little slow."""
    turn, side = rng.uniform(0.0, 360.0), rng.choice([-1.0, 1.0])
    slope = side * rng.uniform(0.006, 0.010)
    gain = {"steering_gain"}
    table: list[tuple[Law, set[str], tuple[str, ...]]] = [
        (Law("steering_gain", "by_angle", {"at_0": 0.90, "at_27": rng.uniform(1.15, 1.22)}), gain, ("angle",)),
        (Law("steering_gain", "over_day", {"mean": 1.0, "amplitude": rng.uniform(0.12, 0.15), "period_s": 1300.0,
                                           "phase_deg": turn}), gain, TIME),
        (Law("steering_deadband", "by_side", {"left": 0.2, "right": rng.uniform(1.4, 1.8)}),
         {"steering_deadband"}, SIDE),
        (Law("steering_rate", "by_side", {"left": rng.uniform(8.0, 10.0), "right": 20.0}), {"steering_rate"},
         SIDE),
        (Law("steering_offset", "over_minutes", {"start": 0.0, "per_minute": side * rng.uniform(1.5, 2.2)}),
         {"steering_offset"}, TIME),
        (Law("steering_gain", "by_place", {"at_origin": 1.0, "per_m_east": 0.0, "per_m_north": slope}),
         gain | {"grip_patch"}, PLACE),
        (Law("steering_offset", "by_implement", {"lifted": 0.0, "working": side * rng.uniform(1.2, 1.8)}),
         {"steering_offset", "implement_side_draft"}, ("implement", "working")),
        (Law("heading_bias", "over_day", {"mean": 0.0, "amplitude": rng.uniform(1.6, 2.2), "period_s": 1500.0,
                                          "phase_deg": turn}), {"heading_bias"}, TIME),
        (Law("steering_gain", "by_speed", {"at_0": 1.2, "per_mps": -rng.uniform(0.10, 0.14)}), gain, ("speed",)),
        (Law("steering_lag", "over_minutes", {"start": 0.6, "per_minute": -0.45}), {"steering_lag"}, TIME),
        (Law("cross_slope_drift", "by_implement", {"lifted": 0.0, "working": rng.uniform(0.03, 0.045)}),
         {"cross_slope_drift"}, ("implement", "working")),
        (Law("speed_lag", "constant", {"value": rng.uniform(0.45, 0.75)}), {"speed_lag"}, ("speed",)),
    ]  # fmt: skip
    cases = []
    for law, also, words in pick(table, 4, rng):
        effects = {law.effect: {"bearing_deg": turn}} if law.effect == "cross_slope_drift" else {}
        wanted = () if law.kind == "constant" else (law.effect,)
        cases.append(build_case("law", draw_seed(rng), effects, laws=(law,), also=also, wanted=wanted, words=words))
    return cases


def draw_faults(rng: Rng) -> list[TruthCase]:
    """One thing that breaks in one of eight runs, at times until the end of its log.

    Runs are those in which it shows at once: a wire that comes loose while the wheels stand still has no onset.
    """
    side = float(rng.choice([-1.0, 1.0]))
    table: list[tuple[str, dict[str, float], str, tuple[int, ...]]] = [
        ("steering_loose", {"linkage": 0.0}, "three_speeds", (4,)),
        ("steering_loose", {"linkage": 1.0}, "three_speeds", (2, 3, 4)),
        ("steering_loose", {"linkage": 0.0}, "closed", (4, 5, 6, 7)),
        ("steering_loose", {"linkage": 0.0}, "mixed", (2, 4)),
        ("steering_stuck", {"side": side}, "three_speeds", (0, 1, 2, 3, 4)),
        ("position_lost", {"mode": 0.0, "size_m": rng.uniform(1.0, 2.5)}, "three_speeds", tuple(range(8))),
        ("position_lost", {"mode": 1.0, "size_m": rng.uniform(1.5, 4.0)}, "mixed", tuple(range(8))),
        ("position_frozen", {}, "mixed", tuple(range(8))),
        ("heading_frozen", {}, "three_speeds", (2, 3, 4)),
        ("speed_frozen", {}, "three_speeds", tuple(range(8))),
        ("wheel_sensor_frozen", {}, "three_speeds", (4,)),
        ("wheel_sensor_frozen", {}, "mixed", (2, 4)),
    ]
    cases = []
    for name, detail, programme, runs in pick(table, 4, rng):
        start = float(rng.uniform(15.0, 30.0))
        end = None if rng.uniform() < 0.5 else start + float(rng.uniform(12.0, 20.0))
        fault = Fault(name, int(rng.choice(runs)), start, end, detail)
        cases.append(build_case("fault", draw_seed(rng), faults=(fault,), programme=programme))
    return cases


def draw_outside(rng: Rng) -> list[TruthCase]:
    """A cause outside the catalogue, with the ids that would still be right and words of a useful hint."""
    turn, run = rng.uniform(0.0, 360.0), int(rng.integers(2, 5))
    push = {"mps2": rng.uniform(0.5, 0.9), "bearing_deg": turn}
    east, north = 12.0 * np.sin(turn), 12.0 * np.cos(turn)
    ways = ("bearing", "heading", "direction", "north", "east")
    table: list[tuple[str, dict[str, float], set[str], tuple[str, ...]]] = [
        ("oil_temperature", {"lag_s": 0.6, "rate_share": 0.5, "warm_s": 350.0},
         {"steering_lag", "steering_rate", "steering_dead_time"}, TIME),
        ("tyre_pressure_loss", {"run": run, "per_minute": rng.uniform(0.8, 1.2)}, set(), TIME),
        ("crosswind", push, {"cross_slope_drift"}, ways),
        ("gravity_slope", push, {"cross_slope_drift"}, ways),
        ("speed_linkage", {"deg_per_mps": rng.uniform(1.0, 1.5)}, set(), ("speed",)),
        ("implement_push", {"side_n": rng.uniform(2000.0, 3000.0)}, {"implement_side_draft"},
         ("implement", "working")),
        ("wheel_wobble", {"angle_deg": rng.uniform(1.5, 2.2), "length_m": rng.uniform(2.0, 4.0)}, set(),
         ("period", "every", "wave", "swing")),
        ("hitch_swing", {"side_n": rng.uniform(4000.0, 7000.0)}, set(), ("period", "swing", "implement", "bend")),
        ("differential_lock", {"share": 1.0, "from_s": 20.0}, set(), ("time", "angle", "bend", "later")),
        ("moist_soil", {"share": rng.uniform(0.15, 0.25), "east_m": east, "north_m": north, "radius_m": 14.0},
         {"grip_patch"}, PLACE),
        ("steering_stiction", {"angle_deg": rng.uniform(1.2, 1.8)}, {"steering_deadband", "steering_backlash"},
         ("steering", "command", "small")),
        ("trees", {"size_m": rng.uniform(0.5, 0.9), "east_m": rng.uniform(-4.0, 4.0), "width_m": 5.0}, set(),
         (*PLACE, "position", "receiver")),
        ("brisk_start", {"mps2": rng.uniform(1.3, 1.8)}, set(), ("start", "speed")),
        ("soft_front_tyres", {"share": rng.uniform(0.22, 0.27)}, {"understeer"}, ("lateral", "speed", "bend")),
        ("articulated", {"joint": rng.uniform(0.4, 0.6), "antenna_forward_m": rng.uniform(-0.8, 0.2)},
         set(), ("steering", "rate", "antenna", "articulated")),
        ("mast_sway", {"m_per_mps2": rng.uniform(0.25, 0.4)}, set(), ("antenna", "position", "lateral")),
        ("governor_hunting", {"share": rng.uniform(0.06, 0.1), "period_s": rng.uniform(3.0, 5.0)}, set(),
         ("speed", "period")),
    ]  # fmt: skip
    return [
        build_case("outside", draw_seed(rng), outside={name: {key: float(value) for key, value in values.items()}},
                   also=also, words=words) for name, values, also, words in pick(table, 5, rng)
    ]  # fmt: skip


def draw_odd_runs(rng: Rng) -> list[TruthCase]:
    """One run of eight with another tractor's values: less gain, another offset, slower steering."""
    table = (
        ("steering_gain", 1.0 - rng.uniform(0.12, 0.18), 1.0, (2, 3, 4)),
        ("steering_offset", float(rng.choice([-1.0, 1.0])) * rng.uniform(1.2, 2.0), 0.0, tuple(range(7))),
        ("steering_lag", rng.uniform(0.4, 0.6), 0.1, (4, 5)),
        ("wheel_slip", rng.uniform(0.09, 0.12), 0.0, tuple(range(7))),
    )
    cases = []
    for name, value, other, runs in pick(table, 2, rng):
        law = Law(name, "by_run", {"run": float(rng.choice(runs)), "value": float(value), "other": other})
        cases.append(build_case("odd_run", draw_seed(rng), laws=(law,), wanted=(), words=("run", "unlike")))
    return cases


def draw_one_sided(rng: Rng) -> list[TruthCase]:
    """Circles to the right only, clean and with something that they cannot tell from its neighbours."""
    clean = TruthCase("one_sided", draw_seed(rng), programme="one_sided", hint_words=("drive", "left"))
    name = str(rng.choice(["steering_gain", "steering_offset", "antenna_right"]))
    return [clean, hide_effects("one_sided", (name,), rng, "one_sided")]


def draw_one_speed(rng: Rng) -> list[TruthCase]:
    """One speed, or angles in order of time, with nothing hidden."""
    return [TruthCase("one_speed", draw_seed(rng), programme=name) for name in ("one_speed", "ordered_angles")]


def draw_mixed(rng: Rng) -> list[TruthCase]:
    """An effect of the catalogue together with a late column."""
    name = str(rng.choice(["steering_offset", "steering_gain", "steering_lag", "antenna_right", "wheel_slip"]))
    hidden = {name: draw_size(name, rng)}
    clocks = {"position": ColumnClock(delay_s=float(rng.uniform(0.2, 0.35)))}
    return [build_case("mixed", draw_seed(rng), hidden, columns=clocks, programme="mixed")]


DRAWS: dict[str, Draw] = {
    "clean": draw_clean, "effect": draw_effects, "pair": draw_pairs, "closed_loop": draw_closed,
    "column": draw_columns, "law": draw_laws, "fault": draw_faults, "outside": draw_outside, "odd_run": draw_odd_runs,
    "one_sided": draw_one_sided, "one_speed": draw_one_speed, "mixed": draw_mixed,
}  # fmt: skip


def draw_third_cases(seed: int, kinds: Iterable[str] | None = None) -> list[TruthCase]:
    """About forty cases of all kinds, or those of `kinds`, in an order drawn by the seed; each kind has its own draws.

    Raises ValueError for an unknown kind.
    """
    cases = []
    for kind in check_kinds(kinds):
        cases += DRAWS[kind](np.random.default_rng([seed, KINDS.index(kind), 41]))
    order = np.random.default_rng([seed, 42]).permutation(len(cases))
    return [cases[place] for place in order]
