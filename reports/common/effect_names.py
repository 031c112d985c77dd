"""Effects by their labels. Files and JSON have ids, which are shown in brackets where a reader needs them."""

from __future__ import annotations

import re
from collections.abc import Mapping

from vehicle.model.effects import EFFECTS_BY_ID

_IDS = re.compile(rf"\b(?:{'|'.join(EFFECTS_BY_ID)})\b")


def get_effect_label(name: str) -> str:
    """The label of an effect; an id that is not in the catalogue is returned unchanged."""
    if name == "discrepancy_model":
        return "discrepancy model"
    return EFFECTS_BY_ID[name].label if name in EFFECTS_BY_ID else name


def format_effect_with_id(name: str) -> str:
    """Label and id: ``steering offset (steering_offset)``; only once when they are the same."""
    return get_effect_label(name) if get_effect_label(name) == name else f"{get_effect_label(name)} ({name})"


def replace_effect_ids(text: str) -> str:
    """A sentence with every id of an effect replaced by its label."""
    return _IDS.sub(lambda match: get_effect_label(match[0]), text)


def format_effect_values(name: str, values: Mapping[str, float]) -> str:
    """The values of an effect with their units: ``1 deg``; ``0.03 m/m, bearing 90 deg``."""
    if name not in EFFECTS_BY_ID:
        return ", ".join(f"{key} {value:.3g}" for key, value in values.items())
    extra_parameters = {param.name: param for param in EFFECTS_BY_ID[name].optional_params}
    params = {param.name: param for param in EFFECTS_BY_ID[name].params} | extra_parameters
    parts = []
    for key, value in values.items():
        prefix = "" if params[key] is EFFECTS_BY_ID[name].size else f"{key.rpartition('_')[0]} "
        prefix = f"{key.replace('_', ' ')} " if key in extra_parameters else prefix
        parts.append(f"{prefix}{value:.3g} {params[key].unit}".rstrip())
    return ", ".join(parts)
