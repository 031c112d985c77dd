"""GeoJSON (RFC 7946): taken apart into a document, before any of its numbers are believed."""

from __future__ import annotations

import json
from typing import Any

from fields.document import LOCAL, WGS84, Document, Format
from fields.errors import FieldError
from fields.formats.features import GEOMETRIES, Feature, document_of, member, text
from fields.reading import parse_fault, read_text

HEADER = "headland"
"""Foreign member (RFC 7946, section 6.1) with the frame of the file; written by ``write_field``."""


def parse(content: str, label: str) -> Document:
    """Take a GeoJSON text apart.

    Args:
        content: what the file holds.
        label: how messages name the file.

    Raises:
        FieldError: it is not JSON, not GeoJSON, or holds no polygon.
    """
    try:
        root = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise FieldError(f"{label} is not JSON ({parse_fault(error)}); give a GeoJSON file.") from error
    if not isinstance(root, dict) or not isinstance(root.get("type"), str):
        raise FieldError(f"{label} is JSON without a 'type', so not GeoJSON; give a FeatureCollection or Polygon.")
    features = _features(root, label)
    header = member(root, HEADER)
    return document_of(
        features, label, crs=_crs(root, label), frame=_frame(header, label), header=header,
        source=text(root.get("source")),
    )  # fmt: skip


def _features(root: dict[str, Any], label: str) -> list[Feature]:
    """Every feature; a bare geometry becomes one."""
    kind = root["type"]
    if kind in GEOMETRIES:
        return [{"type": "Feature", "properties": {}, "geometry": root}]
    if kind == "Feature":
        return [root]
    if kind != "FeatureCollection":
        raise FieldError(f"{label} has the type '{kind}'; give a FeatureCollection, a Feature or a Polygon.")
    features = root.get("features")
    if not isinstance(features, list) or not all(isinstance(feature, dict) for feature in features):
        raise FieldError(f"{label} has no list of features; put every feature into 'features' as an object.")
    if not features:
        raise FieldError(f"{label} is an empty collection; it needs a feature with the boundary as a Polygon.")
    return features


def _crs(root: dict[str, Any], label: str) -> str | None:
    """Name in the ``crs`` member of the GeoJSON format of 2008, section 3."""
    system = root.get("crs")
    if system is None:
        return None
    name = member(system, "properties").get("name") if isinstance(system, dict) else None
    if not isinstance(name, str) or not name:
        raise FieldError(f"The 'crs' of {label} names no coordinate system; remove it or name an EPSG code.")
    return name


def _frame(header: dict[str, Any], label: str) -> str | None:
    frame = header.get("frame")
    if frame not in (None, LOCAL, WGS84):
        raise FieldError(f"The frame {frame!r} of {label} is not known; use '{LOCAL}' or '{WGS84}'.")
    return frame


def _read(path: str, label: str) -> Document:
    return parse(read_text(path, "a GeoJSON file", FieldError), label)


FORMAT = Format("GeoJSON", (".geojson", ".json"), _read)
