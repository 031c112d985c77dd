"""Shapefiles: files, folders and ZIP archives are read, guidance is written, one Shapefile for each kind of feature.

Without a .prj the user must name the coordinate system. Written files are in EPSG:4326 with column names of at most ten
letters, as dBASE requires.
"""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import shapely

from fields.errors import FieldError
from fields.formats.archive import ArchiveMembers, open_folder_or_archive
from fields.formats.gdal import (
    SHAPEFILE_DRIVER,
    LayerFeatures,
    UnknownCrsError,
    build_layer_document,
    name_layer,
    read_layers,
    restrict_gdal_drivers,
)
from fields.formats.guidance import FileContents, GuidanceArea, GuidanceFormat, PlanGuidance, zip_files
from fields.formats.markup import remove_forbidden
from fields.geometry.geodesy import DEGREES_CRS
from fields.raw_document import FieldDocument, FieldFormat

FORMAT_NAME = "a Shapefile"
PART_EXTENSIONS = (".shp", ".shx", ".dbf", ".prj", ".cpg")
SHAPEFILE_MAGIC = (9994).to_bytes(4, "big")
"""First bytes of geometry and index (ESRI Shapefile Technical Description, 1998)."""
FIXED_DATE = "1980-01-01"
"""Date in dBASE tables, fixed so that the same plan gives the same bytes."""
MAX_TEXT_BYTES = 254
"""The longest text of a dBASE table."""

Part = tuple[shapely.Geometry, Mapping[str, Any]]
"""A geometry and its values by column."""


def _read_shapefiles(path: str, label: str) -> FieldDocument:
    place = Path(path)
    members, names = find_shapefiles(place)
    if members.path != place:
        files = (f"{place.stem}.shp", f"{place.stem}.shx")
        missing = [file for file in files if not members.find_paths_by_name(file)]
        if missing:
            raise _build_missing_error(missing, label)
    layers = LayerFeatures()
    systems = set()
    for name in names:
        member_layers = _read_shapefile_features(find_component_files(members, name, label), label)
        if len(names) > 1:
            name_layer(member_layers.features, PurePosixPath(name).stem)
        layers.features += member_layers.features
        layers.notes += member_layers.notes
        systems.add(member_layers.crs)
    if len(systems) > 1:
        raise FieldError(f"{label} contains Shapefiles in different coordinate systems; name one of them.")
    layers.crs = systems.pop() if systems else None
    return build_layer_document(layers, label, "Shapefile")


def find_shapefiles(place: Path) -> tuple[ArchiveMembers, list[str]]:
    """Members and .shp files of a folder or archive, or the .shp file of this name; case is ignored."""
    members = open_folder_or_archive(place)
    names = [one for one in members if one.lower().endswith(".shp")]
    if members.path != place:
        names = [one for one in names if PurePosixPath(one).stem.lower() == place.stem.lower()]
    return members, names


def _read_shapefile_features(parts: Mapping[str, bytes], label: str) -> LayerFeatures:
    """Features of one Shapefile; a .prj that cannot be parsed is ignored with a note."""
    try:
        return read_layers(pack_component_files(parts), label, FORMAT_NAME, (SHAPEFILE_DRIVER,))
    except UnknownCrsError:
        if ".prj" not in parts:
            raise
    other_parts = {ending: content for ending, content in parts.items() if ending != ".prj"}
    layers = read_layers(pack_component_files(other_parts), label, FORMAT_NAME, (SHAPEFILE_DRIVER,))
    layers.notes.append("The .prj cannot be parsed and is ignored.")
    return layers


def find_component_files(members: ArchiveMembers, name: str, label: str) -> dict[str, bytes]:
    """The parts of a Shapefile by their extensions.

    Raises FieldError where its index is missing, or its geometry or index has wrong first bytes.
    """
    stem = PurePosixPath(name).stem
    contents = {ending: members.read_member_beside(name, stem + ending) for ending in PART_EXTENSIONS}
    parts = {ending: content for ending, content in contents.items() if content is not None}
    if ".shx" not in parts:
        raise _build_missing_error([f"{stem}.shx"], label)
    for ending in (".shp", ".shx"):
        if not parts.get(ending, b"").startswith(SHAPEFILE_MAGIC):
            raise FieldError(
                f"{label} cannot be read as {FORMAT_NAME} (the first bytes of {stem}{ending} are wrong); save it again "
                f"as {FORMAT_NAME}."
            )
    return parts


def pack_component_files(parts: Mapping[str, bytes]) -> bytes:
    """The parts of a Shapefile as an in-memory archive, so that GDAL sees no other files and cannot write."""
    return zip_files({f"fields{ending}": content for ending, content in parts.items()}, compression=zipfile.ZIP_STORED)


def _build_missing_error(missing: list[str], label: str) -> FieldError:
    return FieldError(
        f"{label} lacks {' and '.join(missing)}; keep .shp, .shx, .dbf and .prj of a Shapefile together in one folder."
    )


FIELD_FORMAT = FieldFormat(
    "Shapefile",
    (".shp", ".shx", ".dbf", ".prj"),
    _read_shapefiles,
    lambda names: any(n.endswith(".shp") for n in names),
    has_lone_files=False,
)


def _write_shapefiles(guidance: PlanGuidance) -> FileContents:
    boundary = [] if guidance.boundary is None else [guidance.boundary]
    layers: dict[str, list[Part]] = {
        "boundary": [(_build_polygon(area), {"name": guidance.field, "role": "boundary"}) for area in boundary],
        "obstacles": [(_build_polygon(area), {"name": area.name, "role": "obstacle"}) for area in guidance.obstacles],
        "headland": [
            (shapely.linestrings(ring), {"role": "headland"})
            for area in guidance.headland_interior
            for ring in area.closed_rings
        ],
        "entrance": [] if guidance.entrance is None else [(shapely.Point(guidance.entrance), {"role": "entrance"})],
        "lines": [
            (shapely.linestrings(line.points), {
                "name": line.name, "role": "guidance", "tractor": line.tractor, "order": line.order,
                "kind": line.kind, "what": line.description, "bearing": round(line.bearing_deg, 6),
                "length_m": round(line.length_m, 3),
            })
            for line in guidance.lines
        ],
    }  # fmt: skip
    files: dict[str, bytes] = {}
    for name, parts in layers.items():
        files |= _write_layer(name, parts) if parts else {}
    return files


def _build_polygon(area: GuidanceArea) -> shapely.Polygon:
    return shapely.Polygon(area.rings[0], area.rings[1:])


def _write_layer(name: str, parts: Sequence[Part]) -> dict[str, bytes]:
    """The files of one Shapefile, with the columns of its first part."""
    from pyogrio.raw import write

    with tempfile.TemporaryDirectory() as folder, restrict_gdal_drivers(SHAPEFILE_DRIVER):
        place = Path(folder) / f"{name}.shp"
        write(
            place,
            shapely.to_wkb(np.array([shape for shape, _ in parts], dtype=object)),
            [_build_column([values[column] for _, values in parts]) for column in parts[0][1]],
            list(parts[0][1]),
            geometry_type=parts[0][0].geom_type,
            crs=DEGREES_CRS,
            driver=SHAPEFILE_DRIVER,
            encoding="UTF-8",
            DBF_DATE_LAST_UPDATE=FIXED_DATE,
        )
        files = [place.with_suffix(ending) for ending in PART_EXTENSIONS]
        return {file.name: file.read_bytes() for file in files if file.exists()}


def _build_column(values: Sequence[Any]) -> Any:
    kind = type(values[0])
    if kind is str:
        values = [
            remove_forbidden(value).encode("utf-8")[:MAX_TEXT_BYTES].decode("utf-8", "ignore") for value in values
        ]
    return np.array(values, dtype={int: np.int32, float: np.float64}.get(kind, object))


GUIDANCE_FORMAT = GuidanceFormat("shapefile", "Shapefile", _write_shapefiles)
