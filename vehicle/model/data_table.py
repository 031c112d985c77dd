"""Tables of data in CSV, Headland's own and those of users: every line is checked, and a fault is one sentence."""

from __future__ import annotations

from functools import cache
from importlib import resources
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from fields.text_files import CellTable, parse_table, read_table
from vehicle.errors import VehicleError
from vehicle.model.validation_messages import describe_validation_errors

Row = TypeVar("Row", bound=BaseModel)


def load_table(path: str | Path | None, own_name: str, row_type: type[Row], noun: str) -> tuple[Row, ...]:
    """The rows of a user's table, or of Headland's own in vehicle/data/work where `path` is None.

    Empty cells count as left out. Raises VehicleError with the line: `noun` says what a line should be ("a soil").
    """
    if path is None:
        return _load_own_table(own_name, row_type, noun)
    return _parse_rows(read_table(path, "a CSV table", VehicleError), row_type, noun)


@cache
def _load_own_table(name: str, row_type: type[Row], noun: str) -> tuple[Row, ...]:
    """The rows of a table of Headland; rows are never changed."""
    text = (resources.files("vehicle") / "data" / "work" / name).read_text(encoding="utf-8")
    return _parse_rows(parse_table(text, name, VehicleError), row_type, noun)


def _parse_rows(table: CellTable, row_type: type[Row], noun: str) -> tuple[Row, ...]:
    place = table.label
    if not table.rows:
        raise VehicleError(f"The table {place} is empty; give a line of names of columns and a line for {noun}.")
    rows = []
    for (number, _), cells in zip(table.rows, table.list_named_cells(), strict=True):
        place = f"Line {number} of {table.label}"
        try:
            rows.append(row_type(**{name: cell.strip() for name, cell in cells.items() if cell.strip()}))
        except ValidationError as error:
            raise VehicleError(f"{place} is not {noun}: {describe_validation_errors(error, row_type)}.") from None
    return tuple(rows)
