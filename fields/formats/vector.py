"""What GDAL reads, through pyogrio: layers of features become features as GeoJSON has them.

Columns are called in lower case, because a DBF of ten capital letters and a KML of today mean the same by NAME and
name. Heights are dropped.
"""

from __future__ import annotations

import json
import math
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.errors import FieldError
from fields.formats.features import GUIDANCE, LINES, Feature, text
from fields.projection import project

MOST_FEATURES = 100_000
NAMES = ("name", "field_name", "fieldname", "field", "title", "label", "fid_name")
"""Columns that call a feature by its name, the first that says something."""
GATES = ("entrance", "gate")
"""Names of points that are taken for the way in, where no role says so."""
WGS84 = "EPSG:4326"


@dataclass
class Layers:
    """Features of a file so far, the system of their numbers (None while unknown), and what was left out."""

    features: list[Feature] = field(default_factory=list)
    crs: str | None = None
    notes: list[str] = field(default_factory=list)


def read_layers(path: str | Path, label: str, form: str, wanted: tuple[str, ...] | None = None) -> Layers:
    """Every feature of the layers of a file, or of those that are `wanted`.

    Layers in different systems are brought to longitude and latitude.

    Raises:
        FieldError: it is no such file, or holds more than 100,000 features.
    """
    from pyogrio import list_layers
    from pyogrio.errors import DataLayerError, DataSourceError

    found = Layers()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what GDAL mends by itself is no news to a farmer
            names = [str(row[0]) for row in list_layers(path)]
            parts = [_layer(path, name) for name in names if wanted is None or name in wanted]
    except (DataSourceError, DataLayerError, ValueError, RuntimeError, OSError) as error:
        raise FieldError(
            f"{label} cannot be read as {form} ({_first(error, path)}); save it again as {form}."
        ) from None
    if sum(len(part[1]) for part in parts) > MOST_FEATURES:
        raise FieldError(f"{label} holds more than {MOST_FEATURES} features; take the farm's own out of it first.")
    systems = {crs for crs, features, _ in parts if features}
    if None in systems and len(systems) > 1:
        raise FieldError(f"{label} has layers that name no coordinate system beside others that do; give each its own.")
    for crs, features, odd in parts:
        moved = len(systems) > 1 and crs is not None and crs != WGS84
        found.features += [_moved(feature, crs) for feature in features] if moved and crs else features
        found.notes += [odd] if odd else []
    found.crs = systems.pop() if len(systems) == 1 else WGS84 if systems else None
    return found


def named_lines(features: list[Feature]) -> list[Feature]:
    """The features, lines that say nothing else of themselves made guidance lines with a name each."""
    count = 0
    for feature in features:
        properties = feature["properties"]
        if feature["geometry"].get("type") in LINES and not text(properties.get("role")) and "edge" not in properties:
            count += 1
            properties["role"] = GUIDANCE
            properties["name"] = text(properties.get("name")) or f"line {count}"
    return features


def _layer(path: str | Path, name: str) -> tuple[str | None, list[Feature], str]:
    """System, features and a remark of one layer; text that is not what its encoding says is read as Latin-1."""
    from pyogrio.raw import read

    odd = ""
    try:
        meta, _, shapes, columns = read(path, layer=name, force_2d=True, max_features=MOST_FEATURES + 1)
    except UnicodeDecodeError:
        meta, _, shapes, columns = read(
            path, layer=name, force_2d=True, max_features=MOST_FEATURES + 1, encoding="ISO-8859-1"
        )
        odd = f"Names of '{name}' are not in the encoding it says; they are read as Latin-1."
    fields = [str(one).lower() for one in meta["fields"]]
    features = []
    found = shapely.from_wkb(shapes if shapes is not None else [], on_invalid="fix")
    for place, shape in enumerate(found):
        geometry = _geometry(shape)
        properties = {key: _plain(column[place]) for key, column in zip(fields, columns, strict=True)}
        features.append(_feature(geometry, {key: value for key, value in properties.items() if value is not None}))
    return meta["crs"], features, odd


def _geometry(shape: shapely.Geometry | None) -> dict[str, Any]:
    """A shape as GeoJSON has it; nothing for one that GDAL could not read, or that has a position without numbers."""
    if shape is None or shape.is_empty or not np.isfinite(shapely.get_coordinates(shape)).all():
        return {}
    found: dict[str, Any] = json.loads(shapely.to_geojson(shape))
    return found


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> Feature:
    name = next((text(properties[key]) for key in NAMES if text(properties.get(key))), "")
    if name:
        properties["name"] = name
    if geometry.get("type") == "Point" and name.lower() in GATES and not text(properties.get("role")):
        properties["role"] = "entrance"
    return {"type": "Feature", "id": name or None, "properties": properties, "geometry": geometry}


def _plain(value: Any) -> Any:
    """A value of a column as JSON has it, None for what says nothing."""
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, float):
        if not math.isfinite(plain):
            return None
        return int(plain) if plain.is_integer() and abs(plain) < 1e15 else plain
    return plain if isinstance(plain, str | int | bool) or plain is None else str(plain)


def _moved(feature: Feature, crs: str) -> Feature:
    if not feature["geometry"]:
        return feature
    shape = shapely.from_geojson(json.dumps(feature["geometry"]))
    moved = shapely.transform(shape, lambda points: project(points, crs, WGS84))
    return {**feature, "geometry": json.loads(shapely.to_geojson(moved))}


def _first(error: Exception, path: str | Path) -> str:
    """The first sentence of what GDAL says, without the path."""
    words = str(error).splitlines()[0] if str(error) else type(error).__name__
    return words.split(";")[0].replace(f"'{path}' ", "").replace(str(path), "it").replace("'", "").rstrip(".")[:120]
