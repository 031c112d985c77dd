"""Layers of features read by GDAL through pyogrio, with a single driver and restrictive options.

GDAL chooses a driver by the content of a file, and some drivers read other files, query servers or run SQL because a
file says so. Therefore only the driver of the expected format is enabled while a file is read, nothing is fetched, and
no neighbouring file is read. Column names become lower case, as DBF files have capital letters; fields lose heights.
"""

from __future__ import annotations

import io
import json
import math
import os
import re
import threading
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.errors import FieldError
from fields.formats.features import LINE_TYPES, Feature, build_document, convert_to_name_text
from fields.geometry.geodesy import DEGREES_CRS, project
from fields.raw_document import UNKNOWN_CRS, FieldDocument

SHAPEFILE_DRIVER, GEOPACKAGE_DRIVER, FLATGEOBUF_DRIVER, GPX_DRIVER = "ESRI Shapefile", "GPKG", "FlatGeobuf", "GPX"
KML_DRIVERS = ("LIBKML", "KML")  # the first available one is used
SKIP_OPTION = "GDAL_SKIP"
SAFE_OPTIONS: dict[str, str | None] = {
    "CPL_VSIL_CURL_ALLOWED_EXTENSIONS": ".nothing",
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",
    "GDAL_HTTP_CONNECTTIMEOUT": "1",
    "GDAL_HTTP_MAX_RETRY": "0",
    "GDAL_HTTP_TIMEOUT": "1",
    "GDAL_PAM_ENABLED": "NO",
    "GDAL_VRT_ENABLE_PYTHON": "NO",
    "LIBKML_RESOLVE_STYLE": "NO",
    "OGR_SQLITE_ALLOW_EXTERNAL_ACCESS": "NO",
    "OGR_SQLITE_LOAD_EXTENSIONS": None,
    "OGR_SQLITE_PRAGMA": "trusted_schema=OFF,temp_store=MEMORY",
    "SHAPE_RESTORE_SHX": "NO",
}
"""Options of GDAL while untrusted files are read."""
_GDAL_LOCK = threading.RLock()  # drivers and options are global to the process
MAX_FEATURES = 100_000
NAME_COLUMNS = ("name", "field_name", "fieldname", "field", "title", "label", "fid_name")
"""Columns with the name of a feature; the first one that is not empty counts."""
LATIN1 = "ISO-8859-1"
ENCODINGS = (None, LATIN1)
"""Of texts, in this order: what the file says; else any bytes."""
UNSTATED_ENCODINGS = ("UTF-8", *ENCODINGS)
"""Of a Shapefile without a code page: many are in UTF-8 and do not say so."""
CODE_PAGE_EXTENSION = ".cpg"
IN_MEMORY_PREFIX = "pyogrio_"
"""Beginning of the names of layers in files given as bytes."""


@contextmanager
def restrict_gdal_drivers(*drivers: str) -> Iterator[None]:
    """Restrict GDAL to the first available one of these drivers and to safe options until the block ends.

    Other threads that use GDAL through Headland wait meanwhile.

    Raises FieldError where GDAL has none of the drivers, or cannot be restricted.
    """
    import pyogrio

    with _GDAL_LOCK:
        known_drivers = set(pyogrio.list_drivers())
        driver = next((one for one in drivers if one in known_drivers), None)
        if driver is None:
            raise FieldError(f"The installed GDAL cannot read {drivers[0]}; reinstall pyogrio.")
        previous_options = {name: pyogrio.get_gdal_config_option(name) for name in (SKIP_OPTION, *SAFE_OPTIONS)}
        try:
            _register_drivers({**SAFE_OPTIONS, SKIP_OPTION: ",".join(sorted(known_drivers - {driver}))})
            if set(pyogrio.list_drivers()) != {driver}:
                raise FieldError(f"GDAL cannot be restricted to its {driver} driver; install pyogrio 0.10 or newer.")
            yield
        finally:
            # Removing all drivers first restores them in their original order.
            _register_drivers({SKIP_OPTION: ",".join(sorted(known_drivers))})
            _register_drivers(previous_options)


def _register_drivers(options: dict[str, Any]) -> None:
    """Set GDAL options and register its drivers again."""
    import pyogrio
    from pyogrio import core

    pyogrio.set_gdal_config_options(options)
    core._register_drivers()


@dataclass
class LayerFeatures:
    """Features of a file, their coordinate system (None if unknown), and notes of the reader."""

    features: list[Feature] = field(default_factory=list)
    crs: str | None = None
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class LayerTable:
    """A layer read by GDAL: name, system, geometries as WKB, columns by name in lower case, whether read as Latin-1."""

    name: str
    crs: str | None
    shapes: Sequence[bytes | None]
    columns: dict[str, Sequence[Any]]
    is_latin1: bool


class UnknownCrsError(FieldError):
    """A file names a coordinate system that cannot be parsed."""


def read_layers(
    source: Path | bytes,
    label: str,
    format_name: str,
    drivers: tuple[str, ...],
    layer_names: tuple[str, ...] | None = None,
) -> LayerFeatures:
    """All features of the layers of a file, or of the named layers, read by a single GDAL driver.

    Layers in different systems are converted to longitude and latitude.

    Args:
        source: content of the file, for a Shapefile a ZIP archive of its parts; or the path of a checked file.
        label: name of the file in messages.
        format_name: expected format, with an article if it needs one.
        drivers: names of GDAL drivers; the first available one is used.
        layer_names: names of layers, None for all.

    Raises FieldError where the file is in another format, or has more than 100,000 features.
    """
    tables = read_tables(
        source, label, format_name, drivers, layer_names, with_heights=False, max_features=MAX_FEATURES + 1
    )
    if sum(len(table.shapes) for table in tables) > MAX_FEATURES:
        raise FieldError(f"{label} has more than {MAX_FEATURES} features; extract those of the farm first.")
    systems = {table.crs for table in tables if len(table.shapes)}
    if None in systems and len(systems) > 1:
        raise FieldError(f"Some layers of {label} name no coordinate system; give every layer its system.")
    layers = LayerFeatures()
    for table in tables:
        features = _list_features(table, table.crs if len(systems) > 1 else None)
        if layer_names is None and len(tables) > 1:
            name_layer(features, table.name)
        layers.features += features
        if table.is_latin1:
            name = "fields" if table.name.startswith(IN_MEMORY_PREFIX) else table.name
            layers.notes.append(f"Names of '{name}' do not match the declared encoding; they are read as Latin-1.")
    layers.crs = systems.pop() if len(systems) == 1 else DEGREES_CRS if systems else None
    return layers


def read_tables(
    source: Path | bytes,
    label: str,
    format_name: str,
    drivers: tuple[str, ...],
    layer_names: tuple[str, ...] | None = None,
    *,
    with_heights: bool = True,
    max_features: int | None = None,
) -> list[LayerTable]:
    """All layers of a file, or the named ones; arguments as in `read_layers`.

    Text that does not match its declared encoding is read as Latin-1. Raises FieldError for a file in another format.
    """
    from pyogrio import list_layers
    from pyogrio.raw import read

    place = source if isinstance(source, bytes) else _make_absolute(source)
    with _convert_gdal_errors(source, label, format_name), restrict_gdal_drivers(*drivers):
        names = [str(row[0]) for row in list_layers(place)]
        if not names:
            raise ValueError("it has no layer")
        is_stated = SHAPEFILE_DRIVER in drivers and isinstance(place, bytes) and _has_code_page(place)
        encodings = ENCODINGS if is_stated else UNSTATED_ENCODINGS
        tables = []
        for at, name in enumerate(names):  # read by position, as names of in-memory files vary
            if layer_names is not None and name not in layer_names:
                continue
            options = {"layer": at, "force_2d": not with_heights, "max_features": max_features}
            for encoding in encodings:
                with suppress(UnicodeDecodeError):
                    meta, _, shapes, columns = read(place, **options, encoding=encoding)
                    break
            by_name = dict(zip([str(one).lower() for one in meta["fields"]], columns, strict=True))
            tables.append(
                LayerTable(name, meta["crs"], shapes if shapes is not None else [], by_name, encoding == LATIN1)
            )
        return tables


def _has_code_page(archive_bytes: bytes) -> bool:
    """Whether the parts of a Shapefile state the code page of its texts."""
    with zipfile.ZipFile(io.BytesIO(archive_bytes)) as archive:
        parts = [name for name in archive.namelist() if name.lower().endswith(CODE_PAGE_EXTENSION)]
        return any(archive.read(name).strip() for name in parts)


@contextmanager
def _convert_gdal_errors(source: Path | bytes, label: str, format_name: str) -> Iterator[None]:
    """Convert errors of GDAL to FieldError and suppress its warnings."""
    from pyogrio.errors import DataLayerError, DataSourceError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except FieldError:
        raise
    except UnboundLocalError:  # raised by pyogrio if GDAL cannot describe a coordinate system
        raise UnknownCrsError(
            f"{label} names an unknown coordinate system; save it again with a standard one such as EPSG:4326."
        ) from None
    except (DataSourceError, DataLayerError, ValueError, RuntimeError, OSError, IndexError) as error:
        raise FieldError(
            f"{label} cannot be read as {format_name} ({_shorten_gdal_error(error, source)}); save it again as "
            f"{format_name}."
        ) from None


def _make_absolute(path: Path) -> Path:
    """The path for pyogrio, which may take a relative one for an address."""
    return Path(os.path.abspath(path))


def name_layer(features: list[Feature], name: str) -> None:
    """Give features the property "layer", as layers such as "Bäume" say what is in them."""
    for feature in features:
        feature["properties"].setdefault("layer", name)


def build_layer_document(layers: LayerFeatures, label: str, source: str) -> FieldDocument:
    """The document of features of layers, in which lines without a role are guidance lines; raises FieldError."""
    count = 0
    for feature in layers.features:
        properties = feature["properties"]
        if (
            feature["geometry"].get("type") in LINE_TYPES
            and not convert_to_name_text(properties.get("role"))
            and "edge" not in properties
        ):
            count += 1
            properties["name"] = convert_to_name_text(properties.get("name")) or f"line {count}"
    features, notes = layers.features, tuple(layers.notes)
    return build_document(features, label, crs=layers.crs or UNKNOWN_CRS, source=source, notes=notes)


def _list_features(table: LayerTable, crs: str | None) -> list[Feature]:
    """The features of a layer, with its values as JSON has them; converted to degrees from the system `crs`, if any."""
    features = []
    for place, shape in enumerate(shapely.from_wkb(table.shapes, on_invalid="fix")):
        properties = {key: _convert_value(column[place]) for key, column in table.columns.items()}
        properties = {key: value for key, value in properties.items() if value is not None}
        names = (convert_to_name_text(properties.get(key)) for key in NAME_COLUMNS)
        name = next(filter(None, names), "")
        properties |= {"name": name} if name else {}
        geometry = _convert_geometry(shape, crs)
        features.append({"type": "Feature", "id": name or None, "properties": properties, "geometry": geometry})
    return features


def _convert_geometry(shape: shapely.Geometry | None, crs: str | None) -> dict[str, Any]:
    """A shape as a GeoJSON geometry; empty for an unreadable shape or positions that are not finite."""
    if shape is None or shape.is_empty or not np.isfinite(shapely.get_coordinates(shape)).all():
        return {}
    if crs not in (None, DEGREES_CRS):
        shape = shapely.transform(shape, lambda points: project(points, str(crs), DEGREES_CRS))
    geometry: dict[str, Any] = json.loads(shapely.to_geojson(shape))
    return geometry


def _convert_value(value: Any) -> Any:
    """A value of a column as a JSON value, None if it is not finite."""
    python_value = value.item() if isinstance(value, np.generic) else value
    if isinstance(python_value, float):
        if not math.isfinite(python_value):
            return None
        return int(python_value) if python_value.is_integer() and abs(python_value) < 1e15 else python_value
    return python_value if isinstance(python_value, str | int | bool) or python_value is None else str(python_value)


def _shorten_gdal_error(error: Exception, source: Path | bytes) -> str:
    """The first sentence of a GDAL error, without the path."""
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    for path in (str(_make_absolute(source)), str(source)) if isinstance(source, Path) else ():
        reason = reason.replace(f"'{path}' ", "").replace(path, "it")
    reason = re.sub(r"'?/vsi\w+/[^\s';,]+'?", "it", reason)
    return reason.split(";")[0].replace("'", "").rstrip(".")[:120]
