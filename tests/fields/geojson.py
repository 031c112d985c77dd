"""Small GeoJSON documents, and what is said of those that are refused."""

from pathlib import Path
from typing import Any

import pytest

from fields import FieldError, read_field

SQUARE_M = [[0, 0], [200, 0], [200, 100], [0, 100], [0, 0]]
SQUARE_DEG = [[5.0, 52.0], [5.002, 52.0], [5.002, 52.001], [5.0, 52.001], [5.0, 52.0]]


def polygon(*rings: Any) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": list(rings)}


def collection(*features: Any, **members: Any) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": list(features), **members}


def moved(ring: list[list[float]], dx: float, dy: float = 0.0) -> list[list[float]]:
    return [[x + dx, y + dy] for x, y in ring]


def refusal(where: str | Path, **options: Any) -> str:
    """The message of a refusal, checked to be one sentence."""
    with pytest.raises(FieldError) as caught:
        read_field(where, **options)
    text = str(caught.value)
    assert text.endswith(".") and "\n" not in text
    return text
