"""What varies from one day to the next, by how much, and where each figure comes from."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Field

from planner.farm.settings import MAX_DURATION_S, FileSection, define_duration, define_number, define_value

MAX_TAIL_CV = 20.0
MAX_SLIP_PCT = 90.0
_LOG_SOURCE = "17 logs of one attended forage harvester"
_TRACTOR_LIVES = (
    "Kaplan-Meier curves of Zetor tractors (Agronomy 12(6):1364, 2022): half of the worst model fail within 200 engine "
    "hours; at a constant rate that is one in 200 / ln 2 hours"
)
_Duration = Annotated[float, Field(ge=0.0, le=MAX_DURATION_S, strict=True, allow_inf_nan=False)]
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


def _define_cv(default: float, description: str, source: str, high: float = 2.0) -> Any:
    return define_number(default, 0.0, high, description, source)


class UncertaintySettings(FileSection):
    """Laws of the random inputs, as a farm file has them; 0 switches one off. `_cv` are coefficients of variation.

    Those are of lognormal laws. The simulated time of a leg is its median; noise only adds to the mean. `speed_cv` is
    for the speed of each pass, `job_cv` for one factor on all driving of a job, `turn_cv` and `turn_more_cv` for the
    time of turns over one swath and over more. `slip_pct` is the median wheel slip, at which the speeds of a plan hold,
    one value per job. Stops occur at random per driven hour of each tractor, breakdowns once in `breakdown_hours` (0:
    never); `stop_s`, `repair_s` and `start_delay_s` (of the whole fleet) are means. Where `stop_durations_s` are given,
    a stop lasts one of them, all equally likely. Raises pydantic.ValidationError.
    """

    speed_cv: float = _define_cv(
        0.15, "of the speed of one pass", f"{_LOG_SOURCE}: the mean speed of a pass varies by 0.15 to 0.18 within a job"
    )
    job_cv: float = _define_cv(
        0.06,
        "of one factor on all driving of a job",
        f"{_LOG_SOURCE}: time by area, speed and lifts, with one job left out, is off by 4.8 % in the mean; a normal "
        "law with that mean error has a deviation of 6 %",
    )
    slip_pct: float = define_number(
        7.6, 0.0, MAX_SLIP_PCT, "percent of wheel slip, at which speeds hold",
        "log of a New Holland tractor: wheel slip 7.6 % in the median",
    )  # fmt: skip
    slip_cv: float = _define_cv(0.28, "of the slip", "the same log: half of it lies between 6.2 and 9.0 %")
    turn_cv: float = _define_cv(
        0.21, "of the time of a turn to the next track", f"{_LOG_SOURCE}: 163 turns over one track"
    )
    turn_more_cv: float = _define_cv(
        0.13, "of the time of a turn over several tracks", f"{_LOG_SOURCE}: turns over two tracks and three"
    )
    stops_per_hour: float = define_number(
        1.0, 0.0, 1000.0, "stops per tractor and hour",
        f"assumed for a robot: a tenth of the 10 an hour in {_LOG_SOURCE}",
    )  # fmt: skip
    stop_s: float = define_duration(
        48.0, "s, mean length of a stop", f"{_LOG_SOURCE}: stops of 5 s and more last 48 s in the mean"
    )
    stop_cv: float = _define_cv(
        3.9,
        "of the length of a stop",
        f"{_LOG_SOURCE}: median 12 s beside that mean; the law has its 90th percentile at 101 s, measured 109 s",
        MAX_TAIL_CV,
    )
    stop_durations_s: tuple[_Duration, ...] = define_value((), "s of measured stops", "none: the law above")
    breakdown_hours: float = define_number(290.0, 0.0, 1e6, "hours between breakdowns, 0 for none", _TRACTOR_LIVES)
    repair_s: float = define_duration(7200.0, "s, mean length of a repair", "assumed: someone has to come")
    repair_cv: float = _define_cv(
        1.0, "of the length of a repair", "assumed: as much as an exponential law", MAX_TAIL_CV
    )
    start_delay_s: float = define_duration(
        600.0,
        "s, mean delay of the start",
        "assumed: 10 minutes, as the change from field to field took in the median of two campaigns",
    )
    start_delay_cv: float = _define_cv(1.0, "of the delay", "assumed: as much as an exponential law", MAX_TAIL_CV)

    def disable_input(self, input_name: str) -> UncertaintySettings:
        """The same with one of `RANDOM_INPUTS` switched off; raises KeyError for another name."""
        return self.model_copy(update=_OFF_VALUES[input_name])


def build_certain_settings() -> UncertaintySettings:
    """Settings in which no input varies: every sample is the simulation itself."""
    uncertainty = UncertaintySettings()
    for name in RANDOM_INPUTS:
        uncertainty = uncertainty.disable_input(name)
    return uncertainty


def compute_log_deviation(cv: float) -> float:
    """Deviation of the logarithm of a lognormal law with this coefficient of variation."""
    return math.sqrt(math.log1p(cv * cv))
