"""Causes outside the catalogue that the third reference has, as what they do to its body.

| name | values | what it is |
|---|---|---|
| oil_temperature | lag_s, rate_share, warm_s | cold oil: the steering is slower, less so from run to run |
| tyre_pressure_loss | run, per_minute | the front left tyre softens and drags more and more, in one run |
| crosswind | mps2, bearing_deg | a gusty push towards a bearing |
| gravity_slope | mps2, bearing_deg | a slope that nobody measured pulls towards a bearing |
| speed_linkage | deg_per_mps | wheels nearer to straight above 5 km/h, further below, by speed and not by angle |
| implement_push | side_n | an implement off the centre line pushes its hitch aside, by a depth that changes |
| wheel_wobble | angle_deg, length_m | a bent rim steers once a turn |
| hitch_swing | side_n | a trailed implement swings after each bend and pulls |
| differential_lock | share, from_s | the rear wheels are locked together from some time on |
| moist_soil | share, east_m, north_m, radius_m | tyres are softer and slide earlier in one place |
| steering_stiction | angle_deg | the cylinder stays until this much is missing, then goes all the way |
| trees | size_m, east_m, width_m | positions are wrong near a row of trees that runs north |
| brisk_start | mps2 | the tractor gathers and loses speed faster |
| soft_front_tyres | share | the front tyres have this share of their stiffness |
| articulated | joint, antenna_forward_m | bends in its middle; the antenna is so far ahead of its rigid axle |
| mast_sway | m_per_mps2 | the antenna leans out of bends |
| governor_hunting | share, period_s | the speed swings |
"""

import math
from collections.abc import Callable, Mapping

from tests.truth.third_body import Odd

Values = Mapping[str, float]


def turn_bearing(values: Values) -> tuple[float, float]:
    """An acceleration (m/s2) to east and north from its size and bearing."""
    bearing = math.radians(values["bearing_deg"])
    return values["mps2"] * math.sin(bearing), values["mps2"] * math.cos(bearing)


def rename_values(**names: str) -> Callable[[Values, int], dict[str, float]]:
    """A function that gives values of a cause the names of the body's fields (field=value)."""
    return lambda values, index: {field: values[key] for field, key in names.items()}


OUTSIDE_CAUSES: dict[str, Callable[[Values, int], dict[str, float]]] = {
    "oil_temperature": rename_values(),  # of the laws of lag and rate
    "tyre_pressure_loss": lambda values, index: {
        "flat": values["per_minute"] if index == round(values["run"]) else 0.0
    },
    "crosswind": lambda values, index: dict(zip(("wind_east", "wind_north"), turn_bearing(values), strict=True)),
    "gravity_slope": lambda values, index: dict(zip(("fall_east", "fall_north"), turn_bearing(values), strict=True)),
    "speed_linkage": rename_values(speed_link="deg_per_mps"),
    "implement_push": rename_values(hitch_n="side_n"),
    "wheel_wobble": rename_values(wobble="angle_deg", wobble_m="length_m"),
    "hitch_swing": rename_values(swing_n="side_n"),
    "differential_lock": rename_values(locked="share", locked_from_s="from_s"),
    "moist_soil": rename_values(moist="share", moist_east="east_m", moist_north="north_m", moist_radius="radius_m"),
    "steering_stiction": rename_values(stiction="angle_deg"),
    "trees": rename_values(tree_m="size_m", tree_east="east_m", tree_width="width_m"),
    "brisk_start": rename_values(acceleration="mps2"),
    "soft_front_tyres": rename_values(front_stiffness="share"),
    "articulated": rename_values(joint="joint"),
    "mast_sway": rename_values(),  # of the antenna
    "governor_hunting": rename_values(hunting="share", hunting_s="period_s"),
}


def make_odd(outside: Mapping[str, Values], index: int) -> Odd:
    """Causes outside the catalogue as the body wants them, in the run of this index."""
    odd = Odd()
    for name, values in outside.items():
        odd = odd._replace(**OUTSIDE_CAUSES[name](values, index))
    return odd
