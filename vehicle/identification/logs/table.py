"""A log file as columns of numbers, or a refusal in one sentence.

Columns under other names are read by a mapping, which has the name in the file by ours with the unit of the file:
`time_ms = "Zeit"`, `speed_kmh = "v"`, `longitude_deg = "Lon"`. Where ours has the contract's unit and the name in the
file says another, as in `speed_mps = "v [km/h]"`, that counts.
"""

from __future__ import annotations

import io
import json
import warnings
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from fields.errors import mark_parameter, shorten_middle, suggest_name
from fields.nested_text import parse_toml
from fields.text_files import (
    SAMPLE_BYTES,
    TableForm,
    check_header,
    decode_table,
    explain_parse_error,
    find_table_form,
    quote_path,
    read_table_text,
    read_text,
)
from vehicle.identification.errors import ColumnError, LogError
from vehicle.identification.logs.schema import (
    COLUMNS,
    NEEDED_COLUMNS,
    STEERING_COLUMNS,
    TARGETS,
    Array,
    LogConvention,
    Target,
    find_factor,
    parse_target,
    recognise_column,
    split_name,
)

if TYPE_CHECKING:
    import pandas as pd


Columns = dict[str, Array]
_NUMBERS_BY_WORD = {
    column: {word: number for number, words in words_by_number.items() for word in words.split("|")}
    for column, words_by_number in {
        "shuttle": {
            1.0: "f|fwd|forward|v|vor|vorwärts|avant|av|adelante|vooruit",
            0.0: "n|neutral|neutre|neutro|neutraal",
            -1.0: "r|rev|reverse|rück|rückwärts|arrière|ar|atrás|achteruit",
        },
        "implement": {1.0: "true|on|yes|working|down|ein|ja|oui|sí", 0.0: "false|off|no|lifted|up|aus|nein|non|nee"},
    }.items()
}
_EMPTY_CELLS = ("", "nan", "na", "null", "none", "-nan", "n/a")


def read_table(path: Path) -> pd.DataFrame:
    """Read the table of a CSV or Parquet file, cells of a CSV as text.

    Raises LogError.
    """
    if path.is_dir():
        raise LogError(f"{path} is a directory, not a log; name its files, for example {path}/*.csv.")
    if not path.is_file():
        raise LogError(f"{path} does not exist; give the path of a CSV or Parquet log.")
    if path.stat().st_size == 0:
        raise LogError(f"{path} is empty (0 bytes); a log needs a header and at least two rows.")
    return _read_parquet(path) if path.suffix.lower() in (".parquet", ".pq") else _read_csv(path)


def _read_parquet(path: Path) -> pd.DataFrame:
    import pandas as pd

    try:
        return pd.read_parquet(path)
    except ImportError as error:
        raise LogError(f"{path} is Parquet, which needs pyarrow; install pyarrow or save the log as CSV.") from error
    except (ValueError, OSError) as error:
        raise LogError(f"{path} is not a Parquet file ({error}); save the log again, or as CSV.") from error


def _read_csv(path: Path) -> pd.DataFrame:
    import pandas as pd

    with path.open("rb") as stream:
        start = stream.read(SAMPLE_BYTES)
    text = decode_table(start)
    try:
        if "\0" not in text and find_table_form(text) == TableForm():
            check_header(text, str(path), LogError)
            # From a stream pandas reads with one thread; for the path of a large file it would start several.
            # What is not UTF-8 is read below, whole.
            with path.open("rb") as stream, suppress(UnicodeDecodeError):
                return _name_columns_by_header(_parse_csv(stream), path)
        return _name_columns_by_header(_parse_csv(io.StringIO(read_table_text(path, "a log", LogError))), path)
    except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError) as error:
        why = " ".join(str(error).rpartition("error: ")[2].split())
        raise LogError(f"{path} is not a CSV ({why}); every row needs as many cells as the header.") from error


def _parse_csv(stream: IO[Any]) -> pd.DataFrame:
    """The cells as text, the header among them; raises UnicodeDecodeError and errors of pandas."""
    import pandas as pd

    with warnings.catch_warnings():
        # pandas only warns when every row is longer than the header.
        warnings.simplefilter("error", pd.errors.ParserWarning)
        return pd.read_csv(
            stream, dtype=str, keep_default_na=False, skip_blank_lines=False, index_col=False, header=None,
            encoding="utf-8-sig",
        )  # fmt: skip


def _name_columns_by_header(cells: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Take the first row as column names.

    pandas would rename duplicate columns without a message, so they are refused here.
    """
    names = [str(name).strip() for name in cells.iloc[0]]
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1 and name in COLUMNS]
    if twice:
        raise LogError(f"{path} has the column {twice[0]} more than once; keep one of them.")
    table = cells.iloc[1:].reset_index(drop=True)
    table.columns = names
    return table


def extract_columns(frame: pd.DataFrame, name: str) -> tuple[Columns, tuple[str, ...]]:
    """Return known columns as float arrays (NaN for empty or non-numeric cells), and the names of the other columns.

    A column without a single number counts as absent. Raises LogError when required columns are absent or there are
    fewer than two rows.
    """
    header = [str(column) for column in frame.columns]
    _refuse_short_table(frame, header, name)
    present = {column: _parse_numbers(frame[column], column, name) for column in COLUMNS if column in header}
    filled = {column: values for column, values in present.items() if np.isfinite(values).any()}
    steering = [column for column in STEERING_COLUMNS if column in header]
    empty = next((column for column in NEEDED_COLUMNS if column in header and column not in filled), None)
    if empty is None and steering and not any(column in filled for column in steering):
        empty = " or ".join(steering)
    if empty is not None:
        raise LogError(f"{name} has no number in column {empty}; fill it in, it is required.")
    refuse_missing_columns(header, filled, name)
    return filled, tuple(column for column in header if column not in COLUMNS)


def _refuse_short_table(frame: pd.DataFrame, header: list[str], name: str) -> None:
    if not any(column in COLUMNS for column in header) and not offer_mapping(header):
        line = ",".join(header)[:80]
        raise LogError(
            f"{name} is not a log: its first line {line!r} has no known column; start the file with a "
            f"header such as {','.join((*NEEDED_COLUMNS, STEERING_COLUMNS[0]))}."
        )
    if len(frame) < 2:
        rows = "no row" if len(frame) == 0 else "one row"
        raise LogError(f"{name} has a header and {rows}; a log needs at least two rows.")


def _parse_numbers(cells: pd.Series, column: str, name: str) -> Array:
    """Return the numbers of a column, those of times and of words for gears and states where it has no other; refuse
    one that holds text and no number."""
    import pandas as pd

    values: Array = np.array(pd.to_numeric(cells, errors="coerce"), dtype=np.float64)
    if not np.isfinite(values).any():
        text = [str(cell).strip() for cell in cells if not _is_empty(cell)]
        if text and column == "time_s":
            values = _parse_times(cells)
        elif text and column in _NUMBERS_BY_WORD:
            numbers = _NUMBERS_BY_WORD[column]
            values = np.array([numbers.get(str(cell).strip().casefold(), np.nan) for cell in cells])
        if text and not np.isfinite(values).any():
            raise LogError(f"{name} has no number in column {column} (its first cell is {text[0]!r}); write numbers.")
    return values


def _parse_times(cells: pd.Series) -> Array:
    """Return seconds since 1970 (UTC) of dates with times, since midnight of times alone, NaN for other text.

    Dates are ISO 8601 or 31.12.2024.
    """
    import pandas as pd

    text = cells.astype(str).str.strip().str.replace(",", ".", regex=False)
    text = text.str.replace(r"^(\d\d)\.(\d\d)\.(\d{4})", r"\3-\2-\1", regex=True)
    stamps = pd.to_datetime(text, format="ISO8601", utc=True, errors="coerce") - pd.Timestamp(0, tz="UTC")
    since = pd.to_timedelta(text, errors="coerce") if stamps.isna().all() else stamps
    return np.asarray(since / pd.Timedelta(seconds=1), dtype=np.float64)


def _is_empty(cell: object) -> bool:
    return str(cell).strip().lower() in (*_EMPTY_CELLS, "inf", "-inf", "<na>")


# --- columns under other names --------------------------------------------------------------------------------

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
        return [(str(key), str(column)) for key, column in mapping.items()]
    pairs = [(key.strip(), column.strip()) for key, _, column in (str(text).partition("=") for text in mapping or ())]
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
