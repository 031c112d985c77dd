"""What the parameters of the library are called in requests: width_m is width, speed_mps is speed_kmh."""

from __future__ import annotations

_WORDS = {
    "mass_kg": "mass", "steering_rate_deg_per_s": "steering_rate", "cell_bearings": "cell_bearing",
    "counts": "tractors", "fixes": "fix",
    "list_fields": "headland field FILE --list",
}  # fmt: skip
_UNITS = ("_per_deg", "_mps", "_m", "_s", "_deg")

OF_REQUEST = {
    "width": "width_m", "speed_kmh": "speed_mps", "turn_speed_kmh": "turn_speed_mps", "tractors": "tractors",
    "price_per_hour": "price_per_hour", "price_per_tractor": "price_per_tractor", "operation": "operation",
    "tractor": "tractor",
}  # fmt: skip
"""What a farm may set where a request does not, by the names of requests, as parameters of a scenario."""


def word_of(parameter: str) -> str:
    """The name of a parameter without its unit, as the command line and the service have it."""
    if parameter in _WORDS:
        return _WORDS[parameter]
    stem = parameter.removesuffix("_mps") + "_kmh" if parameter.endswith("_mps") else parameter
    for unit in _UNITS:
        stem = stem.removesuffix(unit)
    return stem
