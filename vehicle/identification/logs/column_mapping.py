"""Columns read under other names and in other units by a mapping, and the mapping offered where columns are missing.

A mapping has the column of the file by ours, whose unit is that of the file: `time_ms = "Zeit"`, `speed_kmh = "v"`,
`longitude_deg = "Lon"`. Where ours has the contract's unit and the column's name says another, as in
`speed_mps = "v [km/h]"`, the name counts.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fields.errors import mark_parameter, shorten_middle, suggest_name
from fields.nested_text import parse_toml
from fields.text_files import explain_parse_error, quote_path, read_text
from vehicle.identification.errors import ColumnError, LogError
from vehicle.identification.logs.column_names import (
    TARGETS,
    Target,
    find_factor,
    parse_target,
    recognise_column,
    split_name,
)
from vehicle.identification.logs.schema import COLUMNS, NEEDED_COLUMNS, STEERING_COLUMNS, LogConvention

if TYPE_CHECKING:
    import pandas as pd

MappingSource = Mapping[str, str] | Sequence[str] | str | Path | None
"""A mapping, texts such as "time_s=Zeit", the path of a mapping file (TOML), or nothing."""
SHOWN_HEADER_CHARS = 1000  # of a refusal, which has to leave room for the mapping
_PAIRS = ("easting", "northing"), ("longitude", "latitude")


def parse_mapping(mapping: MappingSource) -> dict[str, str]:
    """The column of the file by ours; raises LogError, in one sentence, for what is no mapping."""
    pairs = _list_pairs(mapping)
    stems, given = [_find_target(key, column).stem for key, column in pairs], mark_parameter("mapping")
    for what in ([TARGETS[stem][0] for stem in stems], [column for _, column in pairs]):
        twice = next((one for one in what if what.count(one) > 1), None)
        if twice is not None:
            both = " and ".join(
                f"{key}={column}" for one, (key, column) in zip(what, pairs, strict=True) if one == twice
            )
            raise LogError(f"{given} {both} are for one column, {twice!r}; keep one of them.")
    if ("longitude" in stems) != ("latitude" in stems):
        has, lacks = ("longitude", "latitude") if "longitude" in stems else ("latitude", "longitude")
        raise LogError(f"{given} has a {has} and no {lacks}; add {lacks}_deg, or give easting_m and northing_m.")
    return dict(pairs)


def _list_pairs(mapping: MappingSource) -> list[tuple[str, str]]:
    if isinstance(mapping, str | Path):
        return _read_mapping_file(mapping)
    if isinstance(mapping, Mapping):
        return list(mapping.items())
    pairs = [(key.strip(), column.strip()) for key, _, column in (text.partition("=") for text in mapping or ())]
    for (key, column), text in zip(pairs, mapping or (), strict=True):
        if not key or not column:
            raise LogError(f"{mark_parameter('mapping')} {text!r} names no column; write it like time_s=Zeit.")
    return pairs


def _read_mapping_file(path: str | Path) -> list[tuple[str, str]]:
    """The pairs of a file, in its table [columns] as for imported logs, or outside of tables."""
    text, label = read_text(path, "a mapping file (TOML)", LogError), f"The mapping {quote_path(path)}"
    try:
        content = parse_toml(text)
    except (ValueError, RecursionError) as error:
        raise LogError(f"{label} is not TOML: {explain_parse_error(error)}.") from None
    columns = content.get("columns", content)
    if not isinstance(columns, dict) or not columns or not all(isinstance(one, str) for one in columns.values()):
        raise LogError(f'{label} does not name columns; write lines such as time_s = "Zeit".')
    return list(columns.items())


def _find_target(key: str, column: str) -> Target:
    """What a pair is for; its unit is that of the key, or where that is the contract's the one of the name."""
    target, given = parse_target(key), f"{mark_parameter('mapping')} {key}={column}"
    if target is None:
        raise LogError(
            f"{given} is for no column of a log{suggest_name(key, COLUMNS)}; use {', '.join(COLUMNS)}, longitude_deg "
            "or latitude_deg, or one of them with the unit of the file, such as speed_kmh."
        )
    unit = split_name(column)[1]
    factor = find_factor(target.quantity, unit)
    if target.quantity and (factor is None or (unit and target.factor not in (None, 1.0, factor))):
        raise LogError(f"{given} contradicts the unit of that column ({unit}); name another one, or rename it.")
    return target._replace(factor=factor if target.factor in (None, 1.0) else target.factor)


def list_mapped_conventions(mapping: Mapping[str, str]) -> frozenset[LogConvention]:
    """The conversion that a mapping to longitude and latitude asks for."""
    is_in_degrees = any(_find_target(*pair).stem == "longitude" for pair in mapping.items())
    return frozenset([LogConvention.POSITION_DEGREES] if is_in_degrees else [])


def map_columns(frame: pd.DataFrame, mapping: Mapping[str, str], name: str) -> pd.DataFrame:
    """The table with the columns of a mapping under the contract's names and in its units, in place of any so named.

    Raises LogError for a column that the table has not, or has twice.
    """
    import pandas as pd

    if not mapping:
        return frame
    header, found = [str(column) for column in frame.columns], {}
    for key, column in mapping.items():
        given = f"{mark_parameter('mapping')} {key}={column}"
        if column not in header:
            close = suggest_name(column, header)
            raise LogError(f"{name} has no column {column!r}{close} for {given} (it has: {_show_header(header)}).")
        if header.count(column) > 1:
            raise LogError(f"{name} has the column {column!r} of {given} more than once; keep or rename one of them.")
        target = _find_target(key, column)
        cells = frame[column]
        is_in_unit = target.factor in (None, 1.0)
        found[target.column] = cells if is_in_unit else pd.to_numeric(cells, errors="coerce") * target.factor
    rest = frame.drop(columns=[column for column in header if column in found or column in mapping.values()])
    return rest.assign(**found)


def offer_mapping(header: Collection[str], present: Collection[str] = ()) -> dict[str, list[str]]:
    """The columns that may be meant by ours, which the names and units of a header suggest; more than one is a doubt.

    Columns of the contract that are `present` need none. Positions in metres are preferred to degrees.
    """
    offers: dict[str, list[str]] = {}
    for column in header:
        target = parse_target(recognise_column(column))
        if target is not None and target.column not in present:
            offers.setdefault(target.stem, []).append(column)
    used, unused = _PAIRS if all(each in offers or f"{each}_m" in present for each in _PAIRS[0]) else _PAIRS[::-1]
    if all(each in offers for each in used) or used is _PAIRS[0]:
        offers = {stem: columns for stem, columns in offers.items() if stem not in unused}
    return offers


def refuse_missing_columns(header: Sequence[str], present: Collection[str], name: str) -> None:
    """Raise ColumnError where a needed column is absent, with all that are and the mapping that names suggest."""
    lacks = [column for column in NEEDED_COLUMNS if column not in present]
    if not any(column in present for column in STEERING_COLUMNS):
        lacks.append(" or ".join(STEERING_COLUMNS))
    if not lacks:
        return
    offers = offer_mapping(header, present)
    sure = {recognise_column(columns[0]): columns[0] for columns in offers.values() if len(columns) == 1}
    advice = [f"if that is what they hold, add {' '.join(map(_show_pair, sure.values()))}"] if sure else []
    for stem, columns in offers.items():
        if len(columns) > 1:
            advice.append(f"{stem} may be one of {len(columns)}: add {' or '.join(map(_show_pair, columns))}")
    meant = {TARGETS[stem][0] for stem in offers}
    unknown = [column for column in lacks if meant.isdisjoint(column.split(" or "))]
    if unknown:
        name_it = f"{mark_parameter('mapping')} {unknown[0].split()[0]}=NAME"
        advice.append(f"no name looks like {' and '.join(unknown)}: say which it is with {name_it}, or log it")
    raise ColumnError(
        f"{name} has no column {', '.join(lacks)} (it has: {_show_header(header)}); {'; '.join(advice)}.", sure
    )


def _show_header(header: Sequence[str]) -> str:
    return shorten_middle(", ".join(header), SHOWN_HEADER_CHARS)


def _show_pair(column: str) -> str:
    """The option that maps a column to what its name suggests."""
    pair = json.dumps(f"{recognise_column(column)}={column}", ensure_ascii=False)
    return f"{mark_parameter('mapping')} {pair}"
