"""A log file as columns of numbers, or one sentence why it is none."""

from __future__ import annotations

import difflib
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vehicle.measured.errors import LogError
from vehicle.measured.logs.record import COLUMNS, NEEDED, STEERING, Array

if TYPE_CHECKING:
    import pandas as pd

Columns = dict[str, Array]
_EMPTY_CELLS = ("", "nan", "na", "null", "none", "-nan", "n/a")


def read_frame(path: Path) -> pd.DataFrame:
    """The table in a CSV or Parquet file, cells of a CSV as text. Raises LogError."""
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
    try:
        with warnings.catch_warnings():
            # pandas only warns when every row is longer than the header.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            return pd.read_csv(
                path, dtype=str, keep_default_na=False, skip_blank_lines=False, index_col=False, header=None,
                encoding="utf-8-sig",
            ).pipe(_with_header, path)  # fmt: skip
    except UnicodeDecodeError as error:
        raise LogError(f"{path} is not a CSV in UTF-8 ({error.reason}); save the log as UTF-8 text.") from error
    except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError) as error:
        why = " ".join(str(error).rpartition("error: ")[2].split())
        raise LogError(f"{path} is not a CSV ({why}); every row needs as many cells as the header.") from error


def _with_header(cells: pd.DataFrame, path: Path) -> pd.DataFrame:
    """First row as names; pandas would rename a column that is there twice instead of saying so."""
    names = [str(name).strip() for name in cells.iloc[0]]
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1 and name in COLUMNS]
    if twice:
        raise LogError(f"{path} has the column {twice[0]} more than once; keep one of them.")
    table = cells.iloc[1:].reset_index(drop=True)
    table.columns = names
    return table


def columns_of(frame: pd.DataFrame, name: str) -> tuple[Columns, tuple[str, ...]]:
    """Known columns as float arrays (NaN where a cell is empty or no number), and the names of the others.

    A column without a single number counts as absent. Raises LogError when a needed column is absent, or when there
    are fewer than two rows.
    """
    _refuse_short(frame, name)
    present = {column: _numbers(frame[column], column, name) for column in COLUMNS if column in frame.columns}
    filled = {column: values for column, values in present.items() if np.isfinite(values).any()}
    for column in NEEDED:
        if column not in filled:
            raise LogError(_missing(column, frame, name))
    if not any(column in filled for column in STEERING):
        raise LogError(_missing(" or ".join(STEERING), frame, name))
    others = tuple(str(column) for column in frame.columns if column not in COLUMNS)
    return filled, others


def _refuse_short(frame: pd.DataFrame, name: str) -> None:
    header = [str(column) for column in frame.columns]
    if not any(column in COLUMNS for column in header):
        near = [column for column in header if difflib.get_close_matches(column, COLUMNS, 1, 0.75)]
        if not near:
            line = ",".join(header)[:80]
            raise LogError(
                f"{name} is not a log: its first line {line!r} holds none of the columns; start the file with a "
                f"header such as {','.join((*NEEDED, STEERING[0]))}."
            )
    if len(frame) < 2:
        rows = "no row" if len(frame) == 0 else "one row"
        raise LogError(f"{name} has a header and {rows}; a log needs at least two rows.")


def _missing(column: str, frame: pd.DataFrame, name: str) -> str:
    header = [str(one) for one in frame.columns]
    wanted = [one for one in column.split(" or ") if one in header]
    if wanted:
        return f"{name} has no number in column {' or '.join(wanted)}; fill it, it is needed."
    stems = {one.lower(): one for one in header if one not in COLUMNS}
    near = [hit for one in column.split(" or ") for hit in difflib.get_close_matches(one, stems, 1, 0.5)]
    hint = f"rename {stems[near[0]]!r} if that is what it holds" if near else "add it"
    return f"{name} has no column {column} (it has: {', '.join(header)}); {hint}."


def _numbers(cells: pd.Series, column: str, name: str) -> Array:
    """Numbers of a column; refuses one that holds text and no number at all."""
    import pandas as pd

    values: Array = np.array(pd.to_numeric(cells, errors="coerce"), dtype=np.float64)
    if not np.isfinite(values).any():
        text = [str(cell).strip() for cell in cells if not _is_empty(cell)]
        if text:
            raise LogError(f"{name} has no number in column {column} (its first cell is {text[0]!r}); write numbers.")
    return values


def _is_empty(cell: object) -> bool:
    return str(cell).strip().lower() in (*_EMPTY_CELLS, "inf", "-inf", "<na>")
