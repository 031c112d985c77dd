"""Read text files that a user named, with one clear sentence for every failure.

Tables are read in any usual form and turned into one: commas between cells, points in numbers.
"""

from __future__ import annotations

import codecs
import csv
import errno
import io
import math
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from fields.errors import HeadlandError, shorten_value

MAX_COLUMNS = 200
MAX_HEADER_CHARS = 20_000  # of the first line
MAX_BYTES = 256 * 2**20  # far more than any field, tractor or table of fixes
MAX_SHOWN_CHARS = 80
DELIMITERS = ",;\t|"
SAMPLE_CHARS, SAMPLE_ROWS = 65_536, 50  # of the beginning, by which the form of a table is recognised
WINDOWS_DEVICE = re.compile(r"(con|prn|aux|nul|(com|lpt)\d)\s*(\.|$)", re.IGNORECASE)
"""A name that Windows reserves for a device."""
_SEPARATOR_LINE = re.compile(r"\Asep=[^\r\n](?=\r?\n)", re.IGNORECASE)
_NUMBER_WITH_COMMA = re.compile(r"\s*[+-]?(\d+|\d{1,3}(\.\d{3})+)?,\d+(e[+-]?\d+)?\s*", re.IGNORECASE)
_NUMBER_WITH_POINT = re.compile(r"\s*[+-]?(\d*|\d{1,3}(,\d{3})+)\.\d+(e[+-]?\d+)?\s*", re.IGNORECASE)
_QUOTED_NUMBER_WITH_COMMA = re.compile(f'"{_NUMBER_WITH_COMMA.pattern}"', re.IGNORECASE)


def check_header(text: str, label: str, error_type: type[HeadlandError]) -> None:
    """Refuse a CSV table with an implausibly long or wide first line, before the rest is parsed for minutes.

    `text` is the table, or at least its first `MAX_HEADER_CHARS` + 1 characters; messages call its file `label`. Raises
    `error_type` where the line is too long, or has too many columns.
    """
    start = io.StringIO(text[: MAX_HEADER_CHARS + 1], newline="")
    try:
        columns = next(csv.reader(start), [])
    except csv.Error as error:
        raise error_type(f"{label} is not a CSV file ({error}); save it as comma-separated text.") from None
    if len(columns) > MAX_COLUMNS:
        raise error_type(f"{label} has more than {MAX_COLUMNS} columns; save only the columns that are needed.")
    if start.tell() > MAX_HEADER_CHARS:
        raise error_type(
            f"The first line of {label} has more than {MAX_HEADER_CHARS} characters; it should name at most "
            f"{MAX_COLUMNS} columns."
        )


def read_text(path: str | Path, kind: str, error_type: type[HeadlandError]) -> str:
    """The text of a file in UTF-8, with or without a byte order mark.

    `path` is as the user gave it ("" is refused), `kind` what it should be, with an article: "a TOML file". Raises
    `error_type` where the file does not exist, is a folder, cannot be read, is empty, too large or not text.
    """
    content = read_bytes(path, kind, error_type)
    if not content.strip():
        raise error_type(f"{quote_path(path)} is empty; give {kind} with something in it.")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise error_type(f"{quote_path(path)} is not a text file in UTF-8; give {kind}.") from None


def read_bytes(path: str | Path, kind: str, error_type: type[HeadlandError]) -> bytes:
    """The bytes of a file; raises as `read_text`, but for text."""
    content = read_start(path, MAX_BYTES + 1, kind, error_type)
    if len(content) > MAX_BYTES:
        raise error_type(f"{quote_path(path)} is larger than {MAX_BYTES >> 20} MB; give {kind} with less in it.")
    return content


def read_start(path: str | Path, count: int, kind: str, error_type: type[HeadlandError]) -> bytes:
    """At most `count` bytes from the beginning of a file; raises as `read_text`, but for text."""
    name = quote_path(path)
    if not os.fspath(path):
        raise error_type(f"The file name is empty; give the name of {kind}.")
    try:
        with open(path, "rb") as stream:
            return stream.read(count)
    except IsADirectoryError:
        raise error_type(f"{name} is a folder; name {kind} in it.") from None
    except FileNotFoundError:
        raise error_type(f"There is no file {name}; check its name and its folder.") from None
    except (OSError, ValueError) as error:
        raise error_type(f"{name} cannot be read ({explain_error(error)}); give {kind} that can be opened.") from None


def explain_error(error: BaseException) -> str:
    """The system's reason for a failure, in a few words without the file's name."""
    if not isinstance(error, OSError):
        return str(error) or type(error).__name__
    reasons = {
        errno.ELOOP: "its symbolic links form a loop",
        errno.ENAMETOOLONG: "its name is too long (more than 255 bytes)",
        errno.ENOSPC: "the disk is full",
        getattr(errno, "EDQUOT", -1): "the disk quota is used up",
        errno.EACCES: "no permission",
        errno.EROFS: "the disk is read-only",
    }
    return reasons.get(error.errno or 0) or error.strerror or type(error).__name__


def quote_path(path: str | Path) -> str:
    """A path in quotes for a sentence; of a very long path only the end."""
    text = os.fspath(path)
    return f"'{text if len(text) <= MAX_SHOWN_CHARS else '...' + text[3 - MAX_SHOWN_CHARS :]}'"


def lower_first(sentence: str) -> str:
    """A sentence as it goes on behind a colon."""
    return sentence[:1].lower() + sentence[1:]


def count_noun(count: int, noun: str) -> str:
    """A count with its noun: 1 ring, 2 rings."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def decode_table(content: bytes) -> str:
    """The text of a table: UTF-8, UTF-16 with its mark, and what is neither as Windows-1252, which any bytes are.

    Without the separator that spreadsheets name in a first line of its own.
    """
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = content.decode("utf-16", "replace")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("cp1252", "replace")
    return _SEPARATOR_LINE.sub("", text)


def normalise_table(text: str) -> str:
    """The table with commas between cells and points in numbers, and the same rows in the same lines.

    Its separator is the one that gives most rows as many cells as the header; of equals, the one that gives most cells.
    Commas in cells are decimal marks where no number of the table has a point. A table that begins in this form and has
    no such commas is returned as it is. Raises csv.Error for a cell that is too long.
    """
    start = text[:SAMPLE_CHARS]
    samples = {one: list(islice(_iter_rows(start, one), SAMPLE_ROWS)) for one in DELIMITERS}
    delimiter = max(DELIMITERS, key=lambda one: _rate_rows(samples[one]))
    first_rows = list(islice(csv.reader(io.StringIO(start, newline="")), SAMPLE_ROWS))
    if first_rows == samples[delimiter] and not _QUOTED_NUMBER_WITH_COMMA.search(text):
        return text
    has_points = any(_NUMBER_WITH_POINT.fullmatch(cell) for row in _iter_rows(text, delimiter) for cell in row)
    rows = _iter_rows(text, delimiter)
    out = io.StringIO(newline="")
    csv.writer(out, lineterminator="\n").writerows(
        rows if has_points else ([_write_with_point(cell) for cell in row] for row in rows)
    )
    return out.getvalue()


def _iter_rows(text: str, delimiter: str) -> Iterator[list[str]]:
    """The rows, without empty cells beyond the last name of the header."""
    width = 0
    for row in csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True):
        width = width or max((at for at, cell in enumerate(row, 1) if cell.strip()), default=0)
        yield row if any(map(str.strip, row[width:])) else row[:width]


def _rate_rows(rows: list[list[str]]) -> tuple[int, int]:
    """How many rows fit the header, and its cells; nothing for a single cell, which any separator makes."""
    width = len(next(filter(None, rows), []))
    return (sum(len(row) == width for row in rows), width) if width > 1 else (0, 0)


def _write_with_point(cell: str) -> str:
    """A number with a decimal comma (1.234,5) with a point (1234.5); any other text as it is."""
    return cell.replace(".", "").replace(",", ".") if _NUMBER_WITH_COMMA.fullmatch(cell) else cell


def read_table_text(path: str | Path, kind: str, error_type: type[HeadlandError]) -> str:
    """The text of a table as `normalise_table` writes it, for readers of comma-separated text.

    `kind` is what the file should be, with an article. Raises `error_type` as `read_bytes`, and for what is no table.
    """
    text, name = decode_table(read_bytes(path, kind, error_type)), quote_path(path)
    if "\0" in text:
        raise error_type(f"{name} is not a CSV file: it contains binary data; save it as text.")
    check_header(text, name, error_type)
    try:
        table = normalise_table(text)
    except csv.Error as error:
        raise error_type(f"{name} is not a CSV file ({error}); save it as comma-separated text.") from None
    check_header(table, name, error_type)
    return table


@dataclass(frozen=True)
class CellTable:
    """A table of text.

    Attributes:
        label: its name in messages.
        header: names of its columns.
        rows: number of the line and cells of each row.
        error_type: class of the exceptions.
    """

    label: str
    header: tuple[str, ...]
    rows: tuple[tuple[int, list[str]], ...]
    error_type: type[HeadlandError]

    def find_column(self, names: Iterable[str]) -> str | None:
        """The column with the first of these names (in lower case) that the table has; its own case is ignored."""
        own_names = {name.lower(): name for name in reversed(self.header)}
        return next((own_names[name] for name in names if name in own_names), None)

    def get_cell(self, row: int, column: str) -> str:
        """The text of a cell, "" in a row that is too short."""
        cells, place = self.rows[row][1], self.header.index(column)
        return cells[place].strip() if place < len(cells) else ""

    def list_cells(self, column: str) -> list[str]:
        """The texts of a column."""
        return [self.get_cell(row, column) for row in range(len(self.rows))]

    def list_named_cells(self) -> list[dict[str, str]]:
        """The cells of each row by their columns; raises `error_type` for a row with more cells than columns."""
        long = next((line for line, cells in self.rows if len(cells) > len(self.header)), None)
        if long is not None:
            place = f"Line {long} of {self.label}"
            raise self.error_type(
                f"{place} has more values than the table has columns; put texts with commas in quotes."
            )
        return [dict(zip(self.header, cells, strict=False)) for _, cells in self.rows]

    def list_numbers(self, column: str) -> list[float]:
        """The numbers of a column, NaN for what is none."""
        return list(map(parse_number, self.list_cells(column)))

    def parse_amount(self, row: int, column: str, most: float) -> float:
        """The number from 0 to `most` in a cell; raises `error_type` for anything else."""
        amount = parse_number(self.get_cell(row, column))
        if not 0.0 <= amount <= most:
            raise self.error_type(f"{self.describe_cell(row, column)}; give a number from 0 to {most:g}.")
        return amount

    def describe_cell(self, row: int, column: str) -> str:
        """What a sentence on a bad cell begins with: its column, value and line."""
        return f"{self.label} has the {column} {shorten_value(self.get_cell(row, column))} in line {self.rows[row][0]}"


def parse_number(value: Any) -> float:
    """A number from a cell of any kind, NaN for what is none."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def parse_table(text: str, label: str, error_type: type[HeadlandError], *, keeps_empty: bool = False) -> CellTable:
    """The table of a comma-separated text, without blank lines and, unless `keeps_empty`, rows of empty cells.

    Raises `error_type` for what is no table.
    """
    check_header(text, label, error_type)
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    try:
        rows = [(reader.line_num, cells) for cells in reader if any(map(str.strip, cells)) or (keeps_empty and cells)]
    except csv.Error as error:
        raise error_type(f"{label} is not a CSV file ({error}); save it as comma-separated text.") from None
    header = rows[0][1] if rows else []
    return CellTable(label, tuple(map(str.strip, header)), tuple(rows[1:]), error_type)


def read_table(path: str | Path, kind: str, error_type: type[HeadlandError]) -> CellTable:
    """The table of a file in any usual form; raises as `read_table_text`."""
    return parse_table(read_table_text(path, kind, error_type), quote_path(path), error_type)
