"""Tables of data in CSV, Headland's own and those of users: every line is checked, and a fault is one sentence."""

from __future__ import annotations

import csv
import io
import os
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from fields.text_files import read_table_text
from vehicle.errors import VehicleError
from vehicle.model.validation_messages import describe_validation_errors

Row = TypeVar("Row", bound=BaseModel)


def load_table(path: str | Path | None, own_name: str, row_type: type[Row], noun: str) -> tuple[Row, ...]:
    """The rows of a user's table, or of Headland's own in vehicle/data/work where `path` is None.

    Empty cells count as left out. Raises VehicleError with the line: `noun` says what a line should be ("a soil").
    """
    if path is None:
        text = (resources.files("vehicle") / "data" / "work" / own_name).read_text(encoding="utf-8")
        place = own_name
    else:
        text, place = read_table_text(path, "a CSV table", VehicleError), os.fspath(path)
    lines = csv.DictReader(io.StringIO(text), skipinitialspace=True)
    try:
        rows = tuple(_parse_row(line, row_type, f"Line {lines.line_num} of {place}", noun) for line in lines)
    except csv.Error as error:
        raise VehicleError(
            f"Line {lines.line_num} of {place} cannot be read ({error}); check its quotes and its length."
        ) from None
    if not rows:
        raise VehicleError(f"The table {place} is empty; give a line of names of columns and a line for {noun}.")
    return rows


def _parse_row(line: dict[Any, Any], row_type: type[Row], place: str, noun: str) -> Row:
    if None in line:
        raise VehicleError(f"{place} has more values than the table has columns; put texts with commas in quotes.")
    try:
        return row_type(**{key: value.strip() for key, value in line.items() if value and value.strip()})
    except ValidationError as error:
        raise VehicleError(f"{place} is not {noun}: {describe_validation_errors(error, row_type)}.") from None
