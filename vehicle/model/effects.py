"""The catalogue of effects that a tractor file can carry and a diagnosis can name.

An entry says which values describe the effect, what is neutral, how large it usually is, which block of the chain it
sits in, what a farmer would call it, what its residual depends on, and which drive shows it. The formulas are in
vehicle.sim.effect_terms. How an effect may follow direction, implement, speed or place needs no entry of its own: those
laws are in vehicle.identification.diagnosis.grammar. tests/vehicle/test_parity.py drives every entry; one that its
drives do not show needs one there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from fields.units import name_compass_point
from vehicle.errors import VehicleError
from vehicle.model.discrepancy_model import NEUTRAL_DISCREPANCY, compute_discrepancy_fields
from vehicle.model.effect_kinds import (
    ABOVE,
    BELOW,
    CIRCLE,
    LIMIT,
    PER_SLOPE,
    REFERENCE_WHEELBASE_M,
    SIZE,
    SLOPE,
    EffectKind,
    EffectParameter,
)
from vehicle.records import DT_S

STEERING, PATH, SPEED, POSITION = "command to wheel", "wheel to path", "speed", "position to antenna"
STEP_HZ = 1.0 / DT_S  # steps of the simulation, in which delays are counted
# The residual in the plot that shows an effect, and what it is plotted against.
TURN, CRAB, WHEEL, PACE = "turning rate", "crab angle", "wheel angle", "speed"
ANGLE, STEERING_SPEED, COMMAND_RATE, SIDE_FORCE = "angle", "steering speed", "rate of command", "side force"
DIRECTION, TOOL, TARGET, TURNING, TIME = "direction", "implement", "target speed", "turning", "time"
TARGET_RATE = "rate of target speed"
DISCREPANCY_KEY = "discrepancy_model"
SLOPE_DRIFT = "cross_slope_drift"
BY_ROLL = "as measured roll has the slope"
STEERING_CLOCK = "clock_offset_steering"
ROUNDING = 1e-9
DRIVE_LINE_SLIP = 0.05  # chosen: speeds of any make differ this much from the set speed
# Chosen: without a load wheels slip less on soil that can be worked; a wrong command looks the same.
MAX_PLAUSIBLE_SLIP = 0.2

Values = Mapping[str, float]
Fields = dict[str, float]

_STEERING_KEYS = {"steering_lag": "lag_s", "steering_rate": "rate_deg_per_s", "steering_deadband": "dead_band_deg"}


@dataclass(frozen=True)
class Effect:
    """One entry. `compute_fields` turns values into fields of MODEL; `describe` writes the sentence of the verdict.

    Fields are linear in the coordinates that `kind` makes of the values, as a diagnosis adds up their slopes; a tangent
    or a square belongs into the formula. A field belongs to one effect alone.
    `regressor` is what the error depends on, `drive` what to drive to see it, `plot` the quantity and the regressor of
    the plot that shows it. `is_stand_in` marks effects that would fit any difference between runs. `kind` says how the
    values become coordinates of a fit. `starts` are coordinates to try first, because a limit leaves no trace where it
    does not act. `optional_params` are values that are given only where more was measured. Effects with
    `is_of_log_alone` are in what a log holds, and not in what guidance gets. `same_law` is the law of another effect
    that says the same, as effect@basis: it is not tried beside this one.
    """

    id: str
    block: str
    params: tuple[EffectParameter, ...]
    compute_fields: Callable[[Values], Fields]
    describe: Callable[[Values], str]
    regressor: str
    drive: str
    plot: tuple[str, str]
    is_stand_in: bool = False
    is_worse_when_less: bool = False
    kind: EffectKind = SIZE
    starts: tuple[float, ...] = ()
    optional_params: tuple[EffectParameter, ...] = ()
    is_of_log_alone: bool = False
    same_law: str = ""

    @property
    def size(self) -> EffectParameter:
        """The parameter that says how large the effect is."""
        return self.params[0]

    @property
    def label(self) -> str:
        """The name of the effect for a reader: its id in words."""
        return self.id.replace("_", " ").replace("gnss", "GNSS")


def _name_left_or_right(value: float) -> str:
    return "right" if value > 0 else "left"


def _describe_turn_gain(value: float) -> str:
    return f"{100 * abs(value - 1):.0f} % {'tighter' if value > 1 else 'wider'}"


def _describe_limit(v: Values) -> str:
    if math.isinf(v["limit_g"]):
        return "The tyres do not slide sideways at any lateral acceleration that was driven."
    return f"The tyres slide sideways above {v['limit_g']:.2f} g of lateral acceleration."


def _describe_slope(v: Values) -> str:
    if PER_SLOPE in v:
        drift = f"{10 * v[PER_SLOPE]:.1f} cm downhill per metre driven across a slope of 10 %"
        return f"The tractor drifts {drift}, {BY_ROLL}."
    towards = name_compass_point(v["bearing_deg"])
    return f"The tractor drifts {100 * v['ratio']:.1f} cm towards the {towards} per metre driven across it."


def _build_clock_effect(
    column: str, what: str, field: str, block: str, plot: tuple[str, str], kind: EffectKind = SIZE
) -> Effect:
    """The effect of a column that is stamped by another clock than the others.

    Of positions and headings only earlier stamps are fitted, as later ones are delays; of commands only later ones, as
    earlier ones are a dead time of the steering; of wheel angles only later ones, as with earlier ones wheels would
    move before their command.
    """
    return Effect(
        f"clock_offset_{column}", block, (EffectParameter("time_s", "s", 0.0, 0.2, 0.1, -2.0, 2.0),),
        lambda v: {field: v["time_s"]},
        lambda v: f"The {what} are stamped {abs(v['time_s']):.2f} s too {'late' if v['time_s'] > 0 else 'early'}: "
                  "another clock than that of the other columns.",
        "changes of speed and steering", "turns at several speeds, stops and starts",
        plot=plot, kind=kind, is_of_log_alone=True,
    )  # fmt: skip


def _build_delay_effect(
    name: str, field: str, sentence: str, regressor: str = "changes of speed and turning rate",
    drive: str = "turns at several speeds, stops and starts",
) -> Effect:  # fmt: skip
    """The effect of a receiver or compass that is late."""
    return Effect(
        name, POSITION, (EffectParameter("time_s", "s", 0.0, 0.15, 0.06, 0.0, 1.2),),
        lambda v: {field: v["time_s"] * STEP_HZ}, lambda v: sentence.format(v["time_s"]),
        regressor, drive, plot=(CRAB, TURNING),
    )  # fmt: skip


CATALOGUE: tuple[Effect, ...] = (
    Effect(
        "steering_offset", PATH, (EffectParameter("angle_deg", "deg", 0.0, 1.0, 0.12, -8.0, 8.0),),
        lambda v: {"offset": math.radians(v["angle_deg"])},
        lambda v: f"The wheels stand {abs(v['angle_deg']):.1f} "
                  f"degrees to the {_name_left_or_right(v['angle_deg'])} when the "
                  "sensor says straight ahead.",
        "always, the same in both directions", "straight ahead, there and back, implement up",
        plot=(TURN, ANGLE),
    ),
    Effect(
        "steering_gain", PATH, (EffectParameter("ratio", "", 1.0, 0.08, 0.02, 0.5, 2.0),),
        lambda v: {"bend": v["ratio"]},
        lambda v: f"The tractor turns {_describe_turn_gain(v['ratio'])} than the file says, on both sides.",
        "wheel angle", "circles to the right and to the left at several angles",
        plot=(TURN, ANGLE),
    ),
    Effect(
        "steering_asymmetry", PATH, (EffectParameter("ratio", "", 1.0, 0.10, 0.02, 0.5, 2.0),),
        lambda v: {"bend_left": v["ratio"]},
        lambda v: f"Left turns are {_describe_turn_gain(v['ratio'])} than the file says, right turns are as it says.",
        "wheel angle to the left", "the same circles to the right and to the left",
        plot=(TURN, ANGLE), same_law="steering_gain@by_side:left",
    ),
    Effect(
        "steering_dead_time", STEERING, (EffectParameter("time_s", "s", 0.0, 0.2, 0.05, 0.0, 1.2),),
        lambda v: {"dead_steps": v["time_s"] * STEP_HZ},
        lambda v: f"The steering starts to move {v['time_s']:.2f} s after the command.",
        "changes of the command", "steps of the steering",
        plot=(WHEEL, COMMAND_RATE),
    ),
    Effect(
        "steering_lag", STEERING, (EffectParameter("time_s", "s", None, 0.2, 0.04, 0.02, 1.5),),
        lambda v: {"lag": v["time_s"]},
        lambda v: f"The steering follows small commands with a time constant of {v['time_s']:.2f} s.",
        "changes of the command", "small steps and quick small waves of the steering",
        plot=(WHEEL, COMMAND_RATE),
    ),
    Effect(
        "steering_rate", STEERING, (EffectParameter("rate_deg_per_s", "deg/s", None, 6.0, 2.0, 1.0, 90.0),),
        lambda v: {"rate": math.radians(v["rate_deg_per_s"])},
        lambda v: f"The steering cannot move faster than {v['rate_deg_per_s']:.1f} degrees a second.",
        "large changes of the command", "steps from lock to lock",
        plot=(WHEEL, COMMAND_RATE),
        is_worse_when_less=True,
    ),
    Effect(
        "steering_deadband", STEERING, (EffectParameter("angle_deg", "deg", None, 0.8, 0.25, 0.0, 6.0),),
        lambda v: {"dead_band": math.radians(v["angle_deg"])},
        lambda v: f"The steering ignores commands closer than {v['angle_deg']:.1f} degrees to where the wheels stand.",
        "small commands", "small steps of the steering, 0.3 to 2 degrees",
        plot=(WHEEL, COMMAND_RATE),
    ),
    Effect(
        "steering_backlash", PATH, (EffectParameter("angle_deg", "deg", 0.0, 1.5, 0.25, 0.0, 8.0),),
        lambda v: {"half_play": math.radians(0.5 * v["angle_deg"])},
        lambda v: f"There are {v['angle_deg']:.1f} degrees of play between the steering sensor and the wheels.",
        "direction of the last steering movement", "slow waves of the steering, 3 degrees each way",
        plot=(TURN, STEERING_SPEED),
    ),
    Effect(
        "side_slip", PATH, (EffectParameter("limit_g", "g", math.inf, 0.1, 0.0, 0.02, math.inf),),
        lambda v: {"slide": 0.0 if math.isinf(v["limit_g"]) else 1.0 / v["limit_g"]},
        _describe_limit,
        "lateral acceleration, above a limit", "the same circle slowly and fast",
        plot=(TURN, SIDE_FORCE), starts=(1.2, 2.0, 4.0, 8.0, 12.0, 18.0), kind=LIMIT,
    ),
    Effect(
        "understeer", PATH, (EffectParameter("deg_per_mps2", "deg per m/s2", 0.0, 1.5, 0.7, -10.0, 30.0),),
        lambda v: {"understeer": math.radians(v["deg_per_mps2"])},
        lambda v: f"The tractor loses {v['deg_per_mps2']:.1f} degrees of steering per m/s2 of lateral acceleration.",
        "lateral acceleration", "the same circle slowly and fast",
        plot=(TURN, SIDE_FORCE),
    ),
    Effect(
        SLOPE_DRIFT, PATH,
        (EffectParameter("ratio", "m/m", 0.0, 0.03, 0.005, 0.0, 0.5),
         EffectParameter("bearing_deg", "deg", 0.0, 90.0, 0.0, 0.0, 360.0)),
        lambda v: {"slope_east": v["ratio"] * math.sin(math.radians(v["bearing_deg"])),
                   "slope_north": v["ratio"] * math.cos(math.radians(v["bearing_deg"]))},
        _describe_slope,
        "direction of travel", "the same line there and back, and one across it",
        plot=(CRAB, DIRECTION), kind=SLOPE,
        optional_params=(EffectParameter(PER_SLOPE, "", 0.0, 0.3, 0.0, 0.0, math.inf),),
    ),
    Effect(
        "implement_side_draft", PATH,
        (EffectParameter("curvature_per_m", "1/m", 0.0, 0.006, 0.0008, -0.1, 0.1, length_power=-1),),
        lambda v: {"draft": v["curvature_per_m"]},
        lambda v: f"The working implement pulls the "
                  f"tractor to the {_name_left_or_right(v['curvature_per_m'])}, as if on a "
                  f"curve of {1 / max(abs(v['curvature_per_m']), 1e-9):.0f} m.",
        "implement working", "straight ahead, implement down and up in turn",
        plot=(TURN, TOOL), same_law="steering_offset@by_implement",
    ),
    Effect(
        "wheel_slip", SPEED, (EffectParameter("ratio", "", 0.0, 0.08, 0.015, -0.5, 0.9),),
        lambda v: {"slip": v["ratio"]},
        lambda v: f"The tractor drives {100 * abs(v['ratio']):.0f} % {'slower' if v['ratio'] > 0 else 'faster'} over "
                  "ground than commanded" + ("." if -DRIVE_LINE_SLIP < v["ratio"] < MAX_PLAUSIBLE_SLIP else
                  ": where wheels do not slip like this, the commanded speed is not what was driven."),
        "commanded speed", "straight ahead at a steady speed, implement up",
        plot=(PACE, TARGET),
    ),
    Effect(
        "implement_slip", SPEED, (EffectParameter("ratio", "", 0.0, 0.10, 0.015, -0.5, 0.9),),
        lambda v: {"tool_slip": v["ratio"]},
        lambda v: f"With the implement working the tractor {'loses' if v['ratio'] >= 0.0 else 'gains'} "
                  f"{100 * abs(v['ratio']):.0f} % of its speed.",
        "implement working", "straight ahead, implement down and up in turn",
        plot=(PACE, TOOL), same_law="wheel_slip@by_implement",
    ),
    Effect(
        "speed_lag", SPEED, (EffectParameter("time_s", "s", 0.0, 1.0, 0.65, 0.0, 5.0),),
        lambda v: {"speed_lag": v["time_s"]},
        lambda v: f"The speed follows a changed command with a time constant of {v['time_s']:.1f} s.",
        "changes of the commanded speed", "straight ahead, the speed in steps, stops and starts",
        plot=(PACE, TARGET_RATE),
    ),
    Effect(
        "antenna_forward", POSITION, (EffectParameter("distance_m", "m", 0.0, 0.4, 0.08, -5.0, 5.0, length_power=1),),
        lambda v: {"shift_forward": v["distance_m"]},
        lambda v: f"The antenna sits {100 * abs(v['distance_m']):.0f} cm further "
                  f"{'forward' if v['distance_m'] > 0 else 'back'} "
                  "than the tractor file says.",
        "turning rate", "tight turns to both sides",
        plot=(CRAB, TURNING),
    ),
    Effect(
        "antenna_right", POSITION, (EffectParameter("distance_m", "m", 0.0, 0.15, 0.03, -5.0, 5.0, length_power=1),),
        lambda v: {"shift_right": v["distance_m"]},
        lambda v: f"The antenna sits {100 * abs(v['distance_m']):.0f} cm "
                  f"further {_name_left_or_right(v['distance_m'])} than "
                  "the tractor file says.",
        "turning rate", "tight turns to both sides",
        plot=(CRAB, TURNING),
    ),
    _build_delay_effect(
        "gnss_latency", "latency", "Position and heading reach the log {:.2f} s late."
    ),
    Effect(
        "heading_bias", POSITION, (EffectParameter("angle_deg", "deg", 0.0, 1.5, 0.25, -20.0, 20.0),),
        lambda v: {"heading_bias": -math.radians(v["angle_deg"])},
        lambda v: f"The measured heading is {abs(v['angle_deg']):.1f} degrees too far to the "
                  f"{_name_left_or_right(v['angle_deg'])}.",
        "always, in every direction", "straight ahead, there and back",
        plot=(CRAB, DIRECTION),
    ),
    _build_delay_effect("position_delay", "position_late", "Positions reach the log {:.2f} s late, headings do not."),
    _build_delay_effect(
        "heading_delay", "heading_late", "Headings reach the log {:.2f} s late, positions do not.",
        "changes of turning rate", "turns at several speeds, into and out of bends",
    ),
    Effect(
        "heading_filter", POSITION, (EffectParameter("time_s", "s", 0.0, 0.3, 0.1, 0.0, 3.0),),
        lambda v: {"heading_filter": v["time_s"]},
        lambda v: f"The heading in the log is smoothed, with a time constant of {v['time_s']:.2f} s.",
        "changes of turning rate", "short bends to both sides, into and out of circles",
        plot=(CRAB, TURNING),
    ),
    Effect(
        "speed_scale", POSITION, (EffectParameter("ratio", "", 1.0, 0.06, 0.015, 0.4, 2.5),),
        lambda v: {"speed_scale": v["ratio"]},
        lambda v: f"The measured speed reads {100 * abs(v['ratio'] - 1):.0f} % {'more' if v['ratio'] > 1 else 'less'} "
                  "than the tractor drives.",
        "speed", "straight ahead at several speeds, implement up",
        plot=(PACE, TARGET), is_of_log_alone=True,
    ),
    _build_clock_effect("position", "positions", "position_clock", POSITION, (CRAB, TURNING), BELOW),
    _build_clock_effect("heading", "headings", "heading_clock", POSITION, (CRAB, TURNING), BELOW),
    _build_clock_effect(
        "speed", "measured speeds", "speed_clock", POSITION, (PACE, TARGET_RATE)
    ),
    _build_clock_effect(
        STEERING_CLOCK.removeprefix("clock_offset_"), "measured wheel angles", "steering_clock", STEERING,
        (WHEEL, COMMAND_RATE), ABOVE,
    ),
    _build_clock_effect(
        "steering_command", "steering commands", "command_clock", STEERING, (WHEEL, COMMAND_RATE), ABOVE
    ),
    Effect(
        "grip_patch", PATH,
        (
            EffectParameter("ratio", "", 1.0, 0.3, 0.06, 0.1, 3.0),
            EffectParameter("east_m", "m", 0.0, 5.0, 0.0, -math.inf, math.inf),
            EffectParameter("north_m", "m", 0.0, 5.0, 0.0, -math.inf, math.inf),
            EffectParameter("radius_m", "m", 0.0, 5.0, 0.0, 0.0, 500.0),
        ),
        lambda v: {"patch": v["ratio"], "patch_east": v["east_m"], "patch_north": v["north_m"],
                   "patch_radius": v["radius_m"]},
        lambda v: f"Within {v['radius_m']:.0f} m of east {v['east_m']:.0f}, north {v['north_m']:.0f} the tractor turns "
                  f"{_describe_turn_gain(v['ratio'])} than elsewhere.",
        "place in the field", "the same bends over the whole field",
        plot=(TURN, ANGLE), kind=CIRCLE, is_stand_in=True,
    ),
    Effect(
        "grip_drift", PATH, (EffectParameter("per_minute", "per minute", 0.0, 0.08, 0.03, -1.0, 1.0),),
        lambda v: {"drift": v["per_minute"] / 60.0},
        lambda v: f"Turns become {100 * abs(v['per_minute']):.0f} % {'tighter' if v['per_minute'] > 0 else 'wider'} "
                  "per minute since the start of the run.",
        "time since the start", "a long circle",
        plot=(TURN, TIME), is_stand_in=True, same_law="steering_gain@over_minutes",
    ),
)  # fmt: skip
EFFECTS_BY_ID = {effect.id: effect for effect in CATALOGUE}


def get_effect(name: str) -> Effect:
    """The entry of an effect. Raises VehicleError for an unknown id."""
    if name not in EFFECTS_BY_ID:
        raise VehicleError(f"The effect {name!r} is unknown; use one of: {', '.join(EFFECTS_BY_ID)}.")
    return EFFECTS_BY_ID[name]


def get_neutral_values(name: str, steering: object) -> dict[str, float]:
    """Neutral values of an effect; `steering` is the section of the tractor file that holds its nominal times."""
    return {
        param.name: getattr(steering, _STEERING_KEYS[name]) if param.neutral is None else param.neutral
        for param in get_effect(name).params
    }


def check_effect(name: str, values: Values, wheelbase_m: float = REFERENCE_WHEELBASE_M) -> None:
    """Raise VehicleError unless the values belong to the effect and are possible on a vehicle of that size."""
    entry = get_effect(name)
    params = (*entry.params, *entry.optional_params)
    known_params = {param.name: param.scale_to_wheelbase(wheelbase_m) for param in params}
    required_names = [param.name for param in entry.params]
    if set(values) - {param.name for param in entry.optional_params} != set(required_names):
        raise VehicleError(
            f"The effect {name} has the values {', '.join(values) or 'none'}; give: {', '.join(required_names)}."
        )
    for key, value in values.items():
        low, high = known_params[key].low, known_params[key].high
        slack = ROUNDING * max(abs(value), 1.0)
        if math.isnan(value) or not low - slack <= value <= high + slack:
            raise VehicleError(f"The effect {name} has {key} = {value:g}; use a value from {low:g} to {high:g}.")


def compute_effect_fields(settings: Mapping[str, Values]) -> Fields:
    """Fields of MODEL for the given effects over neutral ones; `affected` is 1 when any is given.

    Settings may also hold the amounts of a discrepancy model, under DISCREPANCY_KEY.
    """
    fields: Fields = dict(NEUTRAL_FIELDS)
    for name, values in settings.items():
        fields |= (
            compute_discrepancy_fields(values) if name == DISCREPANCY_KEY else get_effect(name).compute_fields(values)
        )
    fields["affected"] = float(bool(settings))
    return fields


def list_neutral_fields(effect: Effect) -> Fields:
    """Fields of MODEL that an effect adds, at neutral; none where neutral is a value of the tractor file."""
    values = {param.name: param.neutral for param in effect.params if param.neutral is not None}
    return effect.compute_fields(values) if len(values) == len(effect.params) else {}


NEUTRAL_FIELDS: Fields = {
    "affected": 0.0,
    **{name: value + 0.0 for effect in CATALOGUE for name, value in list_neutral_fields(effect).items()},
    **NEUTRAL_DISCREPANCY,
}
"""A negative zero becomes 0."""
