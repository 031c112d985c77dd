"""A log file as columns of numbers, or a refusal in one sentence.

Columns under other names are read by a mapping, which has the name in the file by ours with the unit of the file:
`time_ms = "Zeit"`, `speed_kmh = "v"`, `longitude_deg = "Lon"`. Where ours has the usual unit and the name in the file
says another, as in `speed_mps = "v [km/h]"`, that counts.
"""

from __future__ import annotations

import difflib
import io
import json
import re
import unicodedata
import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fields.arrays import Floats
from fields.errors import mark_parameter, shorten_middle, suggest_name
from fields.nested_text import parse_toml
from fields.text_files import quote_path, read_table_text, read_text
from vehicle.identification.errors import ColumnError, LogError
from vehicle.identification.logs.schema import COLUMNS, NEEDED_COLUMNS, STEERING_COLUMNS, Columns

if TYPE_CHECKING:
    import pandas as pd


MappingSource = Mapping[str, str] | Sequence[str] | str | Path | None
"""A mapping, texts such as "time_s=Zeit", the path of a mapping file (TOML), or nothing."""
_LIKENESS = 0.85  # chosen, of difflib's: one letter wrong in a short name, and not another word in it
SHOWN_HEADER_CHARS = 1000  # of a refusal, which has to leave room for the mapping
_EMPTY_CELLS = ("", "nan", "na", "null", "none", "-nan", "n/a", "inf", "-inf", "<na>")


def read_log_table(path: Path) -> pd.DataFrame:
    """Read the table of a CSV or Parquet file, cells of a CSV as text; raises LogError."""
    if path.is_dir():
        raise LogError(f"{path} is a directory, not a log; name its files, for example {path}/*.csv.")
    if not path.is_file():
        raise LogError(f"{path} does not exist; give the path of a CSV or Parquet log.")
    if path.stat().st_size == 0:
        raise LogError(f"{path} is empty (0 bytes); a log needs a header and at least two rows.")
    import pandas as pd

    if path.suffix.lower() in (".parquet", ".pq"):
        try:
            return pd.read_parquet(path)
        except ImportError as error:
            raise LogError(
                f"{path} is Parquet, which needs pyarrow; install pyarrow or save the log as CSV."
            ) from error
        except (ValueError, OSError) as error:
            raise LogError(f"{path} is not a Parquet file ({error}); save the log again, or as CSV.") from error
    text = io.StringIO(read_table_text(path, "a log", LogError).lstrip("\r\n"))
    try:
        with warnings.catch_warnings():
            # pandas only warns when every row is longer than the header.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            cells = pd.read_csv(
                text, dtype=str, keep_default_na=False, skip_blank_lines=False, index_col=False, header=None
            )
    except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError) as error:
        why = " ".join(str(error).rpartition("error: ")[2].split())
        raise LogError(f"{path} is not a CSV ({why}); every row needs as many cells as the header.") from error
    # The first row has the names; pandas would rename duplicate columns without a message.
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
    if not any(map(guess_column, header)):
        line = ",".join(header)[:80]
        raise LogError(
            f"{name} is not a log: its first line {line!r} has no known column; start the file with a "
            f"header such as {','.join((*NEEDED_COLUMNS, STEERING_COLUMNS[0]))}."
        )
    if len(frame) < 2:
        rows = "no row" if len(frame) == 0 else "one row"
        raise LogError(f"{name} has a header and {rows}; a log needs at least two rows.")
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


def _parse_numbers(cells: pd.Series, column: str, name: str) -> Floats:
    """Return the numbers of a column; refuse one that holds text and no number.

    Where it has none, times count as seconds since 1970 (UTC), or since midnight without a date (ISO 8601 or
    31.12.2024), and words for gears and states as their numbers.
    """
    import pandas as pd

    values: Floats = np.array(pd.to_numeric(cells, errors="coerce"), dtype=np.float64)
    if not np.isfinite(values).any():
        text = [cell for cell in map(str.strip, map(str, cells)) if cell.lower() not in _EMPTY_CELLS]
        if text and column == "time_s":
            times = cells.astype(str).str.strip().str.replace(",", ".", regex=False)
            times = times.str.replace(r"^(\d\d)\.(\d\d)\.(\d{4})", r"\3-\2-\1", regex=True)
            stamps = pd.to_datetime(times, format="ISO8601", utc=True, errors="coerce") - pd.Timestamp(0, tz="UTC")
            since = pd.to_timedelta(times, errors="coerce") if stamps.isna().all() else stamps
            values = np.asarray(since / pd.Timedelta(seconds=1), dtype=np.float64)
        elif text and column in (numbers := load_vocabulary().tables["values"]):
            values = np.array([numbers[column].get(str(cell).strip().casefold(), np.nan) for cell in cells])
        if text and not np.isfinite(values).any():
            raise LogError(f"{name} has no number in column {column} (its first cell is {text[0]!r}); write numbers.")
    return values


# --- columns under other names --------------------------------------------------------------------------------


class NamedColumn(NamedTuple):
    """What a mapping calls a column (speed_kmh), our column (speed_mps), and how much of our unit one of its is."""

    key: str
    column: str
    factor: float


class Vocabulary(NamedTuple):
    """The tables of column_names.toml, what its words mean, and patterns of a word in a compound and of a last unit."""

    tables: dict[str, Any]
    roles: dict[str, str]
    word: re.Pattern[str]
    unit_at_end: re.Pattern[str]


@cache
def load_vocabulary() -> Vocabulary:
    """The words and units of names, from vehicle/data/work/column_names.toml."""
    tables = parse_toml((resources.files("vehicle") / "data" / "work" / "column_names.toml").read_text("utf-8"))
    roles = {_flatten(word): role for role, words in tables["words"].items() for word in words.split()}
    # Words of one or two letters stand alone, but those of Japanese are whole words.
    word = _match_longest(one for one in roles if len(one) > 2 or not one.isascii())
    unit = _match_longest(spelling for units in tables["units"].values() for spelling in units)
    unit_at_end = re.compile(rf"(?:[\s_.-]|[\[(/]\s*)({unit})\s*[\])]*$")
    return Vocabulary(tables, roles, re.compile(f"{word}|.+"), unit_at_end)


def _match_longest(texts: Iterable[str]) -> str:
    return "|".join(map(re.escape, sorted(texts, key=len, reverse=True)))


def _flatten(text: str) -> str:
    """A text in small letters without accents."""
    return "".join(one for one in unicodedata.normalize("NFKD", text) if not unicodedata.combining(one)).casefold()


def split_name(name: str) -> tuple[str, str]:
    """A name without accents in small letters, and the unit at its end, "" for none: "v [km/h]" is ("v", "km/h")."""
    plain = _flatten(re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.strip()))
    match = load_vocabulary().unit_at_end.search(plain)
    return (plain[: match.start()].strip(), match[1]) if match else (plain, "")


def read_name(name: str) -> NamedColumn | None:
    """The column of a name; None where a word or the unit is unknown, or where they say two things or nothing."""
    names, (words, unit) = load_vocabulary(), split_name(name)
    tokens = re.findall(r"[^\W_]+", words)
    parts = [part for token in tokens for part in ([token] if token in names.roles else names.word.findall(token))]
    roles = {names.roles.get(part, "unknown") for part in parts} - {"nothing"}
    stem = "_".join(sorted(roles, key="command".__eq__))
    if stem not in names.tables["columns"]:
        return None
    column, quantity = names.tables["columns"][stem]
    units = names.tables["units"][quantity]
    if unit and unit not in units:
        return None
    factor = units[unit] if unit else 1.0
    usual = next((one for one in units if units[one] == factor), "")
    return NamedColumn(f"{stem}_{usual}".rstrip("_"), column, factor)


def guess_column(name: str) -> NamedColumn | None:
    """As `read_name`, but also for one of our names with a letter wrong."""
    near_names = difflib.get_close_matches(name.strip().lower(), COLUMNS, 1, _LIKENESS)
    return read_name(name) or next(map(read_name, near_names), None)


def read_mapping_file(path: str | Path) -> tuple[dict[str, str], dict[str, Any]]:
    """The columns of a mapping file, in [columns] or outside of tables, and its table [values]; raises LogError."""
    text, label = read_text(path, "a mapping file (TOML)", LogError), f"The mapping {quote_path(path)}"
    try:
        content = parse_toml(text)
    except ValueError as error:
        raise LogError(f"{label} is not TOML: {error}.") from None
    values = content.pop("values", {})
    columns = content.get("columns", content)
    are_tables = isinstance(columns, dict) and isinstance(values, dict)
    if not are_tables or not columns or not all(isinstance(name, str) for name in columns.values()):
        raise LogError(f'{label} does not name columns; write lines such as time_s = "Zeit".')
    return columns, values


def list_pairs(mapping: MappingSource) -> list[str]:
    """A mapping as texts such as "time_s=Zeit"; raises LogError as `read_mapping_file` and for a bad line in it."""
    columns = read_mapping_file(mapping)[0] if isinstance(mapping, str | Path) else mapping or ()
    pairs = [f"{key}={name}" for key, name in columns.items()] if isinstance(columns, Mapping) else list(columns)
    if isinstance(mapping, str | Path):
        for pair in pairs:
            _parse_pair(pair, f"{quote_path(mapping)}:")
    return pairs


def parse_mapping(mapping: MappingSource) -> dict[str, NamedColumn]:
    """Our columns by their names in the file; raises LogError, in one sentence, for what is no mapping."""
    found: dict[str, NamedColumn] = {}
    for pair in list_pairs(mapping):
        name, target = _parse_pair(pair, mark_parameter("mapping"))
        twice = [f"{one.key}={other}" for other, one in found.items() if other == name or one.column == target.column]
        if twice:
            raise LogError(f"{mark_parameter('mapping')} {twice[0]} and {pair} are for one column; keep one of them.")
        found[name] = target
    if sum(one.key.startswith(("longitude", "latitude")) for one in found.values()) == 1:
        raise LogError(
            f"{mark_parameter('mapping')} has only one of longitude_deg and latitude_deg; add the other, or give "
            "easting_m and northing_m."
        )
    return found


def _parse_pair(pair: str, source: str) -> tuple[str, NamedColumn]:
    """The name in the file and our column, in the unit of the key or, where that is the usual one, of the name."""
    key, _, name = map(str.strip, str(pair).partition("="))
    given = f"{source} {pair}"
    if not key or not name:
        raise LogError(f"{given} names no column; write it like time_s=Zeit.")
    target, unit = read_name(key), split_name(name)[1]
    if target is None:
        raise LogError(
            f"{given} is for no column of a log{suggest_name(key, COLUMNS)}; use {', '.join(COLUMNS)}, longitude_deg "
            "or latitude_deg, or one of them with the unit of the file, such as speed_kmh."
        )
    said = read_name(f"{split_name(key)[0]} [{unit}]") if unit else target
    if said is None or target.factor not in (1.0, said.factor):
        raise LogError(f"{given} contradicts the unit of that column ({unit}); name another one, or rename it.")
    return name, said


def map_columns(frame: pd.DataFrame, mapping: Mapping[str, NamedColumn], name: str) -> pd.DataFrame:
    """The table with mapped columns under our names, in our units; raises LogError for one it lacks or has twice."""
    import pandas as pd

    header = [str(column) for column in frame.columns]
    for column, target in mapping.items():
        if header.count(column) != 1:
            close = "" if column in header else suggest_name(column, header)
            shown = shorten_middle(", ".join(header), SHOWN_HEADER_CHARS)
            raise LogError(
                f"{name} has {'two columns' if column in header else 'no column'} {column!r}{close} for "
                f"{mark_parameter('mapping')} {target.key}={column} (it has: {shown}); name one of its "
                "columns that is there once."
            )
    if not mapping:
        return frame
    found = {target.column: frame[column] for column, target in mapping.items()}
    for target in mapping.values():
        if target.factor != 1.0:
            found[target.column] = pd.to_numeric(found[target.column], errors="coerce") * target.factor
    return frame.drop(columns=[column for column in header if column in found or column in mapping]).assign(**found)


def refuse_missing_columns(header: Sequence[str], present: Collection[str], name: str) -> None:
    """Raise ColumnError where a needed column is absent, with all that are and the mapping that names suggest, if there
    is one column for each."""
    lacks = [column for column in NEEDED_COLUMNS if column not in present]
    if not any(column in present for column in STEERING_COLUMNS):
        lacks.append(" or ".join(STEERING_COLUMNS))
    if not lacks:
        return
    pairs: dict[str, list[str]] = {}
    for column in header:
        target = guess_column(column)
        if target is not None and target.column not in present:
            pairs.setdefault(target.column, []).append(f"{target.key}={column}")
    sure = [one for one, *others in pairs.values() if not others]
    advice = [f"if that is what they hold, add {_show_options(sure, ' ')}"] if sure else []
    for ours, several in pairs.items():
        if len(several) > 1:
            advice.append(f"{ours} may be one of {len(several)}: add {_show_options(several, ' or ')}")
    unknown = [column for column in lacks if pairs.keys().isdisjoint(column.split(" or "))]
    if unknown:
        name_it = f"{mark_parameter('mapping')} {unknown[0].split()[0]}=NAME"
        advice.append(f"no name looks like {' and '.join(unknown)}: say which it is with {name_it}, or log it")
    shown = shorten_middle(", ".join(header), SHOWN_HEADER_CHARS)
    raise ColumnError(
        f"{name} has no column {', '.join(lacks)} (it has: {shown}); {'; '.join(advice)}.",
        dict(pair.split("=", 1) for pair in sure),
    )


def _show_options(pairs: Sequence[str], between: str) -> str:
    """Options to copy, in the quotes of JSON, which shells understand."""
    return between.join(f"{mark_parameter('mapping')} {json.dumps(pair, ensure_ascii=False)}" for pair in pairs)
