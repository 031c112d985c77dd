"""The base of all refusals, those of the planner, and the names of parameters in them as the API has them.

The command line prints a refusal with its own names for parameters and exits with its `status`, 2 unless it says
otherwise. Any other exception is a bug in Headland and exits with status 1.
"""

from __future__ import annotations

from fields.errors import (
    MAX_FAULTS,
    FieldError,
    HeadlandError,
    attach_parameter,
    make_one_line,
    mark_parameter,
    rename_parameters,
    shorten_value,
    suggest_name,
)

__all__ = [
    "MAX_FAULTS", "FieldError", "HeadlandError", "RequestError", "WorkerError", "attach_parameter", "make_one_line",
    "mark_parameter", "rename_parameters", "render_refusal", "shorten_value", "strip_unit", "suggest_name",
]  # fmt: skip
_OPTION_NAMES = {
    "mass_kg": "mass",
    "moisture_pct": "moisture",
    "steering_rate_deg_per_s": "steering_rate",
    "cell_bearings": "cell_bearing",
    "obstacles": "obstacle",
    "ignored": "ignore",
    "counts": "tractors",
    "fixes": "fix",
    "list_fields": "headland field FILE --list",
}
_UNIT_SUFFIXES = ("_per_deg", "_mps", "_m", "_s", "_deg")


class WorkerError(HeadlandError):
    """A planning process ended or could not be started; the request itself is fine."""

    status = 1


class RequestError(HeadlandError):
    """A request or a combination of its values that cannot be planned."""


def strip_unit(parameter: str) -> str:
    """The name of the option of a parameter: width_m is width and speed_mps is speed_kmh, as in the API.

    The command line writes it with hyphens.
    """
    if parameter in _OPTION_NAMES:
        return _OPTION_NAMES[parameter]
    stem = parameter.removesuffix("_mps") + "_kmh" if parameter.endswith("_mps") else parameter
    for unit in _UNIT_SUFFIXES:
        stem = stem.removesuffix(unit)
    return stem


def render_refusal(refusal: HeadlandError) -> str:
    """A refusal in one sentence, with the names that parameters have in the API."""
    return refusal.render_sentence(strip_unit)
