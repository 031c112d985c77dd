"""A log file as columns of numbers, or a refusal in one sentence."""

from __future__ import annotations

import difflib
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fields.text_files import check_header
from vehicle.identification.errors import LogError
from vehicle.identification.logs.schema import COLUMNS, NEEDED_COLUMNS, STEERING_COLUMNS, Array

if TYPE_CHECKING:
    import pandas as pd


Columns = dict[str, Array]
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
        start = stream.read(65536)
    if b"\0" in start:
        raise LogError(f"{path} is not a CSV: it holds binary data; save the log as comma-separated text.")
    first = start.split(b"\n")[0]
    if b"," not in first and (b";" in first or b"\t" in first):
        raise LogError(f"{path} separates its columns by semicolons or tabs; save it with commas (and decimal points).")
    check_header(start.decode("utf-8-sig", "replace"), str(path), LogError)
    try:
        # From a stream pandas reads with one thread; for the path of a large file it would start several.
        with path.open("rb") as stream, warnings.catch_warnings():
            # pandas only warns when every row is longer than the header.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            return pd.read_csv(
                stream,
                dtype=str,
                keep_default_na=False,
                skip_blank_lines=False,
                index_col=False,
                header=None,
                encoding="utf-8-sig",
            ).pipe(_name_columns_by_header, path)
    except UnicodeDecodeError as error:
        raise LogError(f"{path} is not a CSV in UTF-8 ({error.reason}); save the log as UTF-8 text.") from error
    except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError) as error:
        why = " ".join(str(error).rpartition("error: ")[2].split())
        raise LogError(f"{path} is not a CSV ({why}); every row needs as many cells as the header.") from error


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

    A column without a single number counts as absent. Raises LogError when a required column is absent or there are
    fewer than two rows.
    """
    _refuse_short_table(frame, name)
    present = {column: _parse_numbers(frame[column], column, name) for column in COLUMNS if column in frame.columns}
    filled = {column: values for column, values in present.items() if np.isfinite(values).any()}
    for column in NEEDED_COLUMNS:
        if column not in filled:
            raise LogError(_describe_missing_column(column, frame, name))
    if not any(column in filled for column in STEERING_COLUMNS):
        raise LogError(_describe_missing_column(" or ".join(STEERING_COLUMNS), frame, name))
    ignored = tuple(str(column) for column in frame.columns if column not in COLUMNS)
    return filled, ignored


def _refuse_short_table(frame: pd.DataFrame, name: str) -> None:
    header = [str(column) for column in frame.columns]
    if not any(column in COLUMNS for column in header):
        near_names = [column for column in header if difflib.get_close_matches(column, COLUMNS, 1, 0.75)]
        if not near_names:
            line = ",".join(header)[:80]
            raise LogError(
                f"{name} is not a log: its first line {line!r} has no known column; start the file with a "
                f"header such as {','.join((*NEEDED_COLUMNS, STEERING_COLUMNS[0]))}."
            )
    if len(frame) < 2:
        rows = "no row" if len(frame) == 0 else "one row"
        raise LogError(f"{name} has a header and {rows}; a log needs at least two rows.")


def _describe_missing_column(column: str, frame: pd.DataFrame, name: str) -> str:
    header = [str(column_name) for column_name in frame.columns]
    empty_columns = [column_name for column_name in column.split(" or ") if column_name in header]
    if empty_columns:
        return f"{name} has no number in column {' or '.join(empty_columns)}; fill it in, it is required."
    stems = {column_name.lower(): column_name for column_name in header if column_name not in COLUMNS}
    near_names = [
        hit for column_name in column.split(" or ") for hit in difflib.get_close_matches(column_name, stems, 1, 0.5)
    ]
    hint = f"rename {stems[near_names[0]]!r} if that is what it holds" if near_names else "add it"
    return f"{name} has no column {column} (it has: {', '.join(header)}); {hint}."


def _parse_numbers(cells: pd.Series, column: str, name: str) -> Array:
    """Return the numbers of a column; refuse one that holds text and no number."""
    import pandas as pd

    values: Array = np.array(pd.to_numeric(cells, errors="coerce"), dtype=np.float64)
    if not np.isfinite(values).any():
        text = [str(cell).strip() for cell in cells if not _is_empty(cell)]
        if text:
            raise LogError(f"{name} has no number in column {column} (its first cell is {text[0]!r}); write numbers.")
    return values


def _is_empty(cell: object) -> bool:
    return str(cell).strip().lower() in (*_EMPTY_CELLS, "inf", "-inf", "<na>")
