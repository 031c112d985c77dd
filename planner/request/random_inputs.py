"""What varies from one day to the next, by how much, and where each figure comes from."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

from planner.errors import RequestError, mark_parameter

MAX_CV, MAX_TAIL_CV = 2.0, 20.0
MAX_STOPS_PER_HOUR = 1000.0
MAX_DURATION_S, MAX_BREAKDOWN_INTERVAL_H = 7 * 86400.0, 1e6
MAX_SLIP_PCT = 90.0
_LOG_SOURCE = "17 logs of one attended forage harvester"

PARAMETER_SOURCES = {
    "speed_cv": f"{_LOG_SOURCE}: the mean speed of a pass varies by 0.15 to 0.18 within a job",
    "job_cv": f"{_LOG_SOURCE}: time by area, speed and lifts, with one job left out, is off by 4.8 % in the "
    "mean; a normal law with that mean error has a deviation of 6 %",
    "slip_pct": "log of a New Holland tractor: wheel slip 7.6 % in the median",
    "slip_cv": "the same log: half of it lies between 6.2 and 9.0 %",
    "turn_cv": f"{_LOG_SOURCE}: 163 turns over one track",
    "turn_more_cv": f"{_LOG_SOURCE}: turns over two tracks and three",
    "stops_per_hour": f"assumed for a robot: a tenth of the 10 an hour in {_LOG_SOURCE}",
    "stop_s": f"{_LOG_SOURCE}: stops of 5 s and more last 48 s in the mean",
    "stop_cv": f"{_LOG_SOURCE}: median 12 s beside that mean; the law has its 90th percentile at 101 s, measured 109 s",
    "breakdown_hours": "Kaplan-Meier curves of Zetor tractors (Agronomy 12(6):1364, 2022): half of the worst model "
    "fail within 200 engine hours; at a constant rate that is one in 200 / ln 2 hours",
    "repair_s": "assumed: someone has to come",
    "repair_cv": "assumed: as much as an exponential law",
    "start_delay_s": "assumed: 10 minutes, as the change from field to field took in the median of two campaigns",
    "start_delay_cv": "assumed: as much as an exponential law",
}
"""Where the defaults of `UncertaintySettings` come from, by parameter."""


@dataclass(frozen=True)
class UncertaintySettings:
    """Laws of the random inputs; 0 switches one off. Coefficients of variation (`_cv`) are of lognormal laws.

    The simulated time of a leg is its median; noise only adds to the mean. `speed_cv` is for the speed of each pass,
    `job_cv` for one factor on all driving of a job, `turn_cv` and `turn_more_cv` for the time of turns over one swath
    and over more. `slip_pct` is the median wheel slip, at which the speeds of a plan hold, one value per job. Stops
    occur at random per driven hour of each tractor, breakdowns once in `breakdown_hours` (0: never); `stop_s`,
    `repair_s` and `start_delay_s` (of the whole fleet) are means. Where `stop_durations_s` are given, a stop lasts one
    of them, all equally likely. Raises RequestError.
    """

    speed_cv: float = 0.15
    job_cv: float = 0.06
    slip_pct: float = 7.6
    slip_cv: float = 0.28
    turn_cv: float = 0.21
    turn_more_cv: float = 0.13
    stops_per_hour: float = 1.0
    stop_s: float = 48.0
    stop_cv: float = 3.9
    stop_durations_s: tuple[float, ...] = ()
    breakdown_hours: float = 290.0
    repair_s: float = 7200.0
    repair_cv: float = 1.0
    start_delay_s: float = 600.0
    start_delay_cv: float = 1.0

    def __post_init__(self) -> None:
        for parameter in fields(self):
            values = getattr(self, parameter.name)
            for value in values if isinstance(values, tuple) else (values,):
                _check_value(parameter.name, value, _get_upper_limit(parameter.name))

    def disable_input(self, input_name: str) -> UncertaintySettings:
        """The same with one of `RANDOM_INPUTS` switched off; raises KeyError for another name."""
        return replace(self, **_OFF_VALUES[input_name])


_OFF_VALUES: dict[str, dict[str, Any]] = {
    "pass speed": {"speed_cv": 0.0},
    "conditions of the day": {"job_cv": 0.0},
    "wheel slip": {"slip_cv": 0.0},
    "turns": {"turn_cv": 0.0, "turn_more_cv": 0.0},
    "stops": {"stops_per_hour": 0.0},
    "breakdowns": {"breakdown_hours": 0.0},
    "late start": {"start_delay_s": 0.0},
}
RANDOM_INPUTS = tuple(_OFF_VALUES)
"""Names of the random inputs, as reports call them."""


def build_certain_settings() -> UncertaintySettings:
    """Settings in which no input varies: every sample is the simulation itself."""
    uncertainty = UncertaintySettings()
    for name in RANDOM_INPUTS:
        uncertainty = uncertainty.disable_input(name)
    return uncertainty


def copy_settings(section: Any) -> UncertaintySettings:
    """The settings of an object with values of the same names, as the section of a farm file; others by default."""
    names = (each.name for each in fields(UncertaintySettings))
    return UncertaintySettings(**{name: getattr(section, name) for name in names if hasattr(section, name)})


def compute_log_deviation(cv: float) -> float:
    """Deviation of the logarithm of a lognormal law with this coefficient of variation."""
    return math.sqrt(math.log1p(cv * cv))


def _get_upper_limit(name: str) -> float:
    if name.endswith("_cv"):
        return MAX_TAIL_CV if name in ("stop_cv", "repair_cv", "start_delay_cv") else MAX_CV
    tops = {"stops_per_hour": MAX_STOPS_PER_HOUR, "breakdown_hours": MAX_BREAKDOWN_INTERVAL_H, "slip_pct": MAX_SLIP_PCT}
    return tops.get(name, MAX_DURATION_S)


def _check_value(name: str, value: Any, upper_limit: float) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise RequestError(f"{mark_parameter(name)} is {value!r}; give a number.")
    if not 0.0 <= value <= upper_limit:
        raise RequestError(f"{mark_parameter(name)} is {value:g}; use 0 to {upper_limit:g}.")
