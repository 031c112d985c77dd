"""A log file as columns of numbers, or a refusal in one sentence."""

from __future__ import annotations

import io
import warnings
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from fields.text_files import check_header
from fields.text_tables import SAMPLE_BYTES, decode_table, find_table_form, read_table_text
from vehicle.identification.errors import LogError
from vehicle.identification.logs.column_mapping import offer_mapping, refuse_missing_columns
from vehicle.identification.logs.schema import COLUMNS, NEEDED_COLUMNS, STEERING_COLUMNS, Array

if TYPE_CHECKING:
    import pandas as pd


Columns = dict[str, Array]
_NUMBERS_BY_WORD = {
    column: {word: number for number, words in words_by_number.items() for word in words.split()}
    for column, words_by_number in {
        "shuttle": {
            1.0: "f fwd forward v vor vorwärts avant av adelante vooruit",
            0.0: "n neutral neutre neutro neutraal",
            -1.0: "r rev reverse rück rückwärts arrière ar atrás achteruit",
        },
        "implement": {1.0: "true on yes working down ein ja oui sí", 0.0: "false off no lifted up aus nein non nee"},
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
        if "\0" not in text and find_table_form(text).is_plain:
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
