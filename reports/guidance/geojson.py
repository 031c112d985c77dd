"""GeoJSON (RFC 7946) with the roles that Headland reads fields by: boundary, obstacle, entrance, guidance, headland."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from reports.guidance.form import Files, Form
from reports.guidance.lines import Area, Degrees, Guidance

DECIMALS = 9


def _write(guidance: Guidance) -> Files:
    body = ",\n".join(json.dumps(one, ensure_ascii=False, allow_nan=False) for one in _features(guidance))
    text = f'{{"type": "FeatureCollection", "features": [\n{body}\n]}}\n'
    return {"guidance.geojson": text.encode("utf-8", "replace")}


def _features(guidance: Guidance) -> Iterator[dict[str, Any]]:
    if guidance.boundary is not None:
        yield _feature("Polygon", _rings(guidance.boundary), role="boundary", name=guidance.field)
    for area in guidance.obstacles:
        yield _feature("Polygon", _rings(area), role="obstacle", name=area.name)
    if guidance.entrance is not None:
        yield _feature("Point", _positions(np.array([guidance.entrance]))[0], role="entrance")
    for area in guidance.inside_headland:
        for ring in _rings(area):
            yield _feature("LineString", ring, role="headland")
    for line in guidance.lines:
        yield _feature(
            "LineString", _positions(line.points), role="guidance", name=line.name, tractor=line.tractor,
            order=line.order, kind=line.kind, what=line.words, straight=line.straight,
            bearing_deg=round(line.bearing_deg, 6), length_m=round(line.length_m, 3),
        )  # fmt: skip


def _feature(form: str, coordinates: Any, /, **properties: Any) -> dict[str, Any]:
    geometry = {"type": form, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _rings(area: Area) -> list[Any]:
    return [_positions(np.concatenate([ring, ring[:1]])) for ring in area.rings]


def _positions(points: Degrees) -> list[list[float]]:
    return [[round(float(x), DECIMALS), round(float(y), DECIMALS)] for x, y in points]


FORM = Form("geojson", "GeoJSON", _write, ending=".geojson", media="application/geo+json")
