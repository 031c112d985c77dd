"""Names of options: those of parameters without their units, so width_m is width and speed_mps is speed_kmh."""

from __future__ import annotations

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


def strip_unit(parameter: str) -> str:
    """The name of the option of a parameter, as in the API; the command line writes it with hyphens."""
    if parameter in _OPTION_NAMES:
        return _OPTION_NAMES[parameter]
    stem = parameter.removesuffix("_mps") + "_kmh" if parameter.endswith("_mps") else parameter
    for unit in _UNIT_SUFFIXES:
        stem = stem.removesuffix(unit)
    return stem
