"""Plain values for JSON: what it cannot hold is null."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def finite(value: Any, decimals: int | None = None) -> Any:
    """Plain Python values: floats that are not finite are None, numpy values unpacked, tuples lists, keys text.

    With `decimals` floats are rounded, and none is -0.0.
    """
    if isinstance(value, Mapping):
        return {str(key): finite(item, decimals) for key, item in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [finite(item, decimals) for item in value]
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return value if decimals is None else round(value, decimals) + 0.0
    return value
