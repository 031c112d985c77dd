"""Tables of text as people's programs save them, turned into one form: commas between cells, points in numbers."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fields.errors import HeadlandError
from fields.text_files import check_header, quote_path, read_bytes

DELIMITERS = ",;\t|"
"""Separators of columns; the first of those that make the same table counts."""
SAMPLE_BYTES, SAMPLE_ROWS = 65_536, 50  # of the beginning, by which the form is recognised
WINDOWS_ENCODING = "cp1252"
_UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_NUMBER_WITH_COMMA = re.compile(r"\s*[+-]?(\d+|\d{1,3}(\.\d{3})+)?,\d+(e[+-]?\d+)?\s*", re.IGNORECASE)
_NUMBER_WITH_POINT = re.compile(r"\s*[+-]?\d*\.\d+(e[+-]?\d+)?\s*", re.IGNORECASE)


@dataclass(frozen=True)
class TableForm:
    """How a table is written: its separator, whether commas are decimal marks, and whether empty cells end its rows."""

    delimiter: str
    has_decimal_commas: bool
    has_trailing_separators: bool

    @property
    def is_plain(self) -> bool:
        """Whether the table is in the form that every reader takes."""
        return self == TableForm(DELIMITERS[0], False, False)


def decode_table(content: bytes) -> str:
    """The text of a table: UTF-8, UTF-16 with its mark, and what is neither as Windows-1252, which any bytes are."""
    if content.startswith(_UTF16_MARKS):
        return content.decode("utf-16", "replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode(WINDOWS_ENCODING, "replace")


def find_table_form(text: str) -> TableForm:
    """The form of a table by its beginning.

    Its separator is the one that gives most rows as many cells as the header; of equals, the one that gives most cells.
    Commas are decimal marks where they separate nothing; in quotes between commas, where no number has a point.
    """
    start = text[:SAMPLE_BYTES]
    samples = {delimiter: _list_rows(start, delimiter) for delimiter in DELIMITERS}
    delimiter = max(DELIMITERS, key=lambda one: _rate_rows(samples[one]))
    rows = samples[delimiter]
    cells = [cell for row in rows[1:] for cell in row]
    is_commas = delimiter != "," or (
        any(map(_NUMBER_WITH_COMMA.fullmatch, cells)) and not any(map(_NUMBER_WITH_POINT.fullmatch, cells))
    )
    width = _count_columns(rows[0]) if rows else 0
    return TableForm(delimiter, is_commas, any(len(row) > width and not row[-1].strip() for row in rows))


def _list_rows(text: str, delimiter: str) -> list[list[str]]:
    """The first rows that are not empty; a row that is cut off at the end counts as any other."""
    rows = []
    try:
        for row in csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True):
            rows += [row] if any(cell.strip() for cell in row) else []
            if len(rows) == SAMPLE_ROWS:
                break
    except csv.Error:  # a cell without an end, which whoever reads the table refuses
        return []
    return rows


def _count_columns(header: list[str]) -> int:
    return max((at for at, cell in enumerate(header, 1) if cell.strip()), default=0)


def _rate_rows(rows: list[list[str]]) -> tuple[int, int]:
    """How many rows fit the header, and its cells; nothing for a single cell, which any separator makes."""
    width = _count_columns(rows[0]) if rows else 0
    if width < 2:
        return 0, 0
    return sum(len(row) >= width and not any(map(str.strip, row[width:])) for row in rows), width


def normalise_table(text: str) -> str:
    """The table in the plain form, with the same rows in the same lines; unchanged where it is in that form.

    Raises:
        csv.Error: a cell is too long or has no end.
    """
    text = text.removeprefix("\ufeff")
    form = find_table_form(text)
    if form.is_plain:
        return text
    out = io.StringIO(newline="")
    csv.writer(out, lineterminator="\n").writerows(_iter_plain_rows(text, form))
    return out.getvalue()


def _iter_plain_rows(text: str, form: TableForm) -> Iterator[list[str]]:
    width = 0
    for row in csv.reader(io.StringIO(text, newline=""), delimiter=form.delimiter, skipinitialspace=True):
        width = width or _count_columns(row)
        while len(row) > width and not row[-1].strip():
            row.pop()
        yield [_write_with_point(cell) for cell in row] if form.has_decimal_commas else row


def _write_with_point(cell: str) -> str:
    """A number with a decimal comma (1.234,5) with a point (1234.5); any other text as it is."""
    return cell.replace(".", "").replace(",", ".") if "," in cell and _NUMBER_WITH_COMMA.fullmatch(cell) else cell


def read_table_text(path: str | Path, kind: str, error_type: type[HeadlandError]) -> str:
    """The text of a table in the plain form, for readers of comma-separated text.

    `kind` is what the file should be, with an article. Raises `error_type` as `read_bytes`, and for what is no table.
    """
    text, name = decode_table(read_bytes(path, kind, error_type)), quote_path(path)
    if "\0" in text:
        raise error_type(f"{name} is not a CSV file: it contains binary data; save it as text.")
    check_header(text, name, error_type, find_table_form(text).delimiter)
    try:
        return normalise_table(text)
    except csv.Error as error:
        raise error_type(f"{name} is not a CSV file ({error}); save it as comma-separated text.") from None


def read_table_rows(path: str | Path, kind: str, error_type: type[HeadlandError]) -> list[list[str]]:
    """The rows of a table that are not empty; raises as `read_table_text`."""
    text = read_table_text(path, kind, error_type)
    try:
        return [row for row in csv.reader(io.StringIO(text, newline="")) if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise error_type(f"{quote_path(path)} is not a CSV file ({error}); save it as comma-separated text.") from None
