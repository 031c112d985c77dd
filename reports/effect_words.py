"""Effects by their words; the id, which is what files and JSON have, stands beside where a reader needs it."""

from __future__ import annotations

import re
from collections.abc import Mapping

from vehicle.effects import BY_ID

_IDS = re.compile(rf"\b(?:{'|'.join(BY_ID)})\b")


def label(name: str) -> str:
    """The words of an effect; an id that is not in the catalogue stays as it is."""
    return BY_ID[name].label if name in BY_ID else name


def both(name: str) -> str:
    """Words first, id beside: ``steering offset (steering_offset)``; once when they are the same."""
    return label(name) if label(name) == name else f"{label(name)} ({name})"


def spelled(text: str) -> str:
    """A sentence with the ids in it as words."""
    return _IDS.sub(lambda match: label(match[0]), text)


def capital(text: str) -> str:
    """Text that begins with a capital; those inside stay."""
    return text[:1].upper() + text[1:]


def value_words(name: str, values: Mapping[str, float]) -> str:
    """The values of an effect with their units: ``1 deg``; ``0.03 m/m, bearing 90 deg``."""
    if name not in BY_ID:
        return ", ".join(f"{key} {value:.3g}" for key, value in values.items())
    also = {param.name: param for param in BY_ID[name].also}
    params = {param.name: param for param in BY_ID[name].params} | also
    parts = []
    for key, value in values.items():
        what = "" if params[key] is BY_ID[name].size else f"{key.rpartition('_')[0]} "
        what = f"{key.replace('_', ' ')} " if key in also else what
        parts.append(f"{what}{value:.3g} {params[key].unit}".rstrip())
    return ", ".join(parts)
