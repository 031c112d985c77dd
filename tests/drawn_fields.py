"""Files drawn by hand: fields as GeoJSON, and heights as an ASCII grid; metres, x = east and y = north."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray
Geometry = dict[str, Any]


def ring(*corners: tuple[float, float]) -> Geometry:
    """A polygon of these corners."""
    return {"type": "Polygon", "coordinates": [[list(corner) for corner in (*corners, corners[0])]]}


def rectangle(x: float, y: float, wide: float, high: float) -> Geometry:
    """A polygon with its corner in the south-west at a place."""
    return ring((x, y), (x + wide, y), (x + wide, y + high), (x, y + high))


def line(*points: Any) -> Geometry:
    """A line through these points."""
    return {"type": "LineString", "coordinates": [list(point) for point in points]}


def point(x: float, y: float) -> Geometry:
    """A place."""
    return {"type": "Point", "coordinates": [x, y]}


def feature(geometry: Any, **properties: Any) -> dict[str, Any]:
    """A feature with these properties."""
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def write_features(path: Path, *features: Any) -> Path:
    """A file of features."""
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}), encoding="utf-8")
    return path


def write_farm(path: Path, **fields: tuple[float, float, float]) -> Path:
    """A file of rectangles with a name and an ID each: place to the east, width and height (m)."""
    named = [feature(rectangle(x, 0, wide, high), name=name) | {"id": name} for name, (x, wide, high) in fields.items()]
    return write_features(path, *named)


def write_heights(
    path: Path, compute: Callable[[Array, Array], Array], low_m: float, high_m: float, cell_m: float = 2.0
) -> Path:
    """An ASCII grid of heights (m) computed from east and north, from one place to another on both axes."""
    places = np.arange(low_m, high_m, cell_m) + 0.5 * cell_m
    heights = compute(*np.meshgrid(places, places[::-1]))
    rows = "\n".join(" ".join(f"{height:.4f}" for height in row) for row in heights)
    head = f"ncols {len(places)}\nnrows {len(places)}\nxllcorner {low_m:g}\nyllcorner {low_m:g}\ncellsize {cell_m}"
    path.write_text(f"{head}\n{rows}\n")
    return path
