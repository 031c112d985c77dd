"""Effects the truth model can hide, with their parameters, neutral and clear sizes.

Sign conventions (angles of steering in degrees, positive to the right; bearings clockwise from north):

| id | parameters | positive means |
|---|---|---|
| steering_offset | angle_deg | the wheels stand to the right when the sensor says 0 |
| steering_gain | ratio | more path curvature per steering angle on both sides when above 1 |
| steering_asymmetry | ratio | more path curvature on the left side only when above 1 |
| steering_dead_time | time_s | the command reaches the valve this much later |
| steering_lag | time_s | time constant of small movements (0.1 is neutral) |
| steering_rate | rate_deg_per_s | speed of large movements (16 is neutral) |
| steering_deadband | angle_deg | half width: commands closer than this to the wheel angle do nothing (0.1 is neutral) |
| steering_backlash | angle_deg | whole width: the sensor moves this far at a reversal before the wheels follow |
| side_slip | limit_g | lateral acceleration, in g, at which both axles slide |
| understeer | deg_per_mps2 | steering lost towards straight ahead per m/s2 of lateral acceleration |
| cross_slope_drift | ratio, bearing_deg | metres of sideways drift per metre driven across; bearing points downhill |
| implement_side_draft | curvature_per_m | the path bends to the right while the implement works |
| wheel_slip | ratio | share of the commanded speed that is lost |
| implement_slip | ratio | the same while the implement works |
| speed_lag | time_s | time constant from commanded to driven speed (0 is neutral: the quickness every tractor has) |
| antenna_forward | distance_m | the antenna sits further forward than the tractor file says |
| antenna_right | distance_m | the antenna sits further right than the tractor file says |
| gnss_latency | time_s | position and heading are this old |
| heading_bias | angle_deg | measured minus true heading, clockwise |
| grip_patch | ratio, east_m, north_m, radius_m | curvature factor inside the circle (field frame, see Truth.origin) |
| grip_drift | per_minute | growth of the curvature factor since the first row of the run |

Outside the catalogue (`OUTSIDE`):

| id | parameters | what it is |
|---|---|---|
| steering_temperature | share, period_s | curvature factor 1 + share * sin(2 pi t / period), t of the day |
| speed_pull | deg_per_m2ps2 | wheel angle to the right that grows with the square of speed (tie-rod compliance) |
| steering_wobble | angle_deg, period_s | periodic wheel angle behind the sensor |
| tyre_relaxation | length_m | relaxation length of both axles (0.3 is neutral) |
| wind_drift | speed_mps, bearing_deg | sideways push over the ground towards the bearing while the tractor moves |
"""

import math
from collections.abc import Mapping

Effects = Mapping[str, Mapping[str, float]]

CATALOGUE: dict[str, dict[str, tuple[float, float]]] = {
    "steering_offset": {"angle_deg": (0.0, 1.0)},
    "steering_gain": {"ratio": (1.0, 1.08)},
    "steering_asymmetry": {"ratio": (1.0, 1.1)},
    "steering_dead_time": {"time_s": (0.0, 0.25)},
    "steering_lag": {"time_s": (0.1, 0.35)},
    "steering_rate": {"rate_deg_per_s": (16.0, 9.0)},
    "steering_deadband": {"angle_deg": (0.1, 1.0)},
    "steering_backlash": {"angle_deg": (0.0, 1.5)},
    "side_slip": {"limit_g": (math.inf, 0.08)},
    "understeer": {"deg_per_mps2": (0.0, 2.0)},
    "cross_slope_drift": {"ratio": (0.0, 0.03), "bearing_deg": (0.0, 200.0)},
    "implement_side_draft": {"curvature_per_m": (0.0, 0.006)},
    "wheel_slip": {"ratio": (0.0, 0.08)},
    "implement_slip": {"ratio": (0.0, 0.1)},
    "speed_lag": {"time_s": (0.0, 1.2)},
    "antenna_forward": {"distance_m": (0.0, 0.4)},
    "antenna_right": {"distance_m": (0.0, 0.15)},
    "gnss_latency": {"time_s": (0.0, 0.2)},
    "heading_bias": {"angle_deg": (0.0, 1.5)},
    "grip_patch": {"ratio": (1.0, 0.7), "east_m": (0.0, 12.0), "north_m": (0.0, 8.0), "radius_m": (0.0, 15.0)},
    "grip_drift": {"per_minute": (0.0, 0.1)},
}
"""Parameters of each effect: neutral, and of a clear size."""
OUTSIDE_CATALOGUE: dict[str, dict[str, tuple[float, float]]] = {
    "steering_temperature": {"share": (0.0, 0.12), "period_s": (40.0, 40.0)},
    "speed_pull": {"deg_per_m2ps2": (0.0, 0.4)},
    "steering_wobble": {"angle_deg": (0.0, 1.5), "period_s": (4.0, 4.0)},
    "tyre_relaxation": {"length_m": (0.3, 1.5)},
    "wind_drift": {"speed_mps": (0.0, 0.05), "bearing_deg": (0.0, 60.0)},
}
PLACES = ("bearing_deg", "east_m", "north_m", "radius_m", "period_s")  # where an effect is, not how large


def _take(table: Mapping[str, Mapping[str, tuple[float, float]]], place: int) -> dict[str, dict[str, float]]:
    return {name: {key: pair[place] for key, pair in values.items()} for name, values in table.items()}


NEUTRAL, CLEAR_SIZES = _take(CATALOGUE, 0), _take(CATALOGUE, 1)
OUTSIDE_NEUTRAL, OUTSIDE = _take(OUTSIDE_CATALOGUE, 0), _take(OUTSIDE_CATALOGUE, 1)


def complete(effects: Effects) -> dict[str, dict[str, float]]:
    """Parameters of every known effect: the given ones over the neutral ones.

    Raises ValueError for an id or a parameter that the tables above do not have.
    """
    known = {**NEUTRAL, **OUTSIDE_NEUTRAL}
    for name, values in effects.items():
        if name not in known:
            raise ValueError(f"The effect {name!r} is unknown; use one of: {', '.join(known)}.")
        wrong = sorted(set(values) - set(known[name]))
        if wrong:
            raise ValueError(f"The effect {name} has no parameter {wrong[0]!r}; it has: {', '.join(known[name])}.")
    return {name: {**neutral, **effects.get(name, {})} for name, neutral in known.items()}


def scaled(name: str, share: float) -> dict[str, float]:
    """Parameters a `share` of the way from neutral (0) to the clear size (1); a friction limit scales as 1 / share."""
    neutral = {**NEUTRAL, **OUTSIDE_NEUTRAL}[name]
    clear = {**CLEAR_SIZES, **OUTSIDE}[name]
    if name == "side_slip":
        return {"limit_g": clear["limit_g"] / share if share > 0 else float("inf")}
    return {
        key: value if key in PLACES else neutral[key] + share * (value - neutral[key]) for key, value in clear.items()
    }
