"""Rain of the last days as a request gives it, by which the moisture of a soil is estimated."""

from __future__ import annotations

from pathlib import Path

from fields.text_files import parse_number, parse_table, read_table_text
from planner.errors import RequestError, mark_parameter, shorten_value

TABLE_SUFFIX = ".csv"
MAX_DAYS, MAX_RAIN_MM, MAX_ET0_MM = 366, 1000.0, 20.0
RAIN_FORMAT = "millimetres by day from the oldest to yesterday, such as 0,12,5, or a CSV file with a column rain_mm"
DEFAULT_ET0_MM = (3.0, 2.0, 5.0)
"""Reference evapotranspiration by day: likely, least and greatest. FAO-56, table 2: humid temperate regions, cool (2 to
3) to moderate (3 to 5); give that of the days in dry or warm weather."""
ET0_ERROR = 0.2  # assumed, of an evapotranspiration that is given
RainyDays = tuple[tuple[float, ...], tuple[tuple[float, float, float], ...]]


def is_rain_table(text: str) -> bool:
    """Whether rain is given as a file."""
    return text.strip().lower().endswith(TABLE_SUFFIX)


def parse_recent_rain(text: str, et0_mm: float | None = None) -> RainyDays:
    """Rain (mm) and evapotranspiration (likely, least and greatest mm) by day, the oldest first, in RAIN_FORMAT.

    A file has a row per day, and may have a column et0_mm, which counts instead of `et0_mm`. Raises RequestError.
    """
    if is_rain_table(text):
        rows = _read_rows(text.strip())
    else:
        rows = [(amount, None) for amount in map(parse_number, text.split(","))]
        for part, (amount, _) in zip(text.split(","), rows, strict=True):
            if not 0.0 <= amount <= MAX_RAIN_MM:
                raise RequestError(
                    f"{mark_parameter('rain_mm')} {shorten_value(text)} has {shorten_value(part)}, which is no number "
                    f"from 0 to {MAX_RAIN_MM:g}; give {RAIN_FORMAT}."
                )
    if not 1 <= len(rows) <= MAX_DAYS:
        raise RequestError(
            f"{mark_parameter('rain_mm')} {shorten_value(text)} has {len(rows)} days; give 1 to {MAX_DAYS}.",
            parameter="rain_mm",
        )
    likely_mm = [et0_mm if own is None else own for _, own in rows]
    ranges = [
        DEFAULT_ET0_MM if one is None else (one, (1.0 - ET0_ERROR) * one, (1.0 + ET0_ERROR) * one) for one in likely_mm
    ]
    return tuple(rain for rain, _ in rows), tuple(ranges)


def _read_rows(name: str) -> list[tuple[float, float | None]]:
    label = f"{mark_parameter('rain_mm')} file {shorten_value(name)}"
    text = read_table_text(Path(name), "a CSV file", RequestError)
    table = parse_table(text, label, RequestError, keeps_empty=True)
    rain, et0 = table.find_column(["rain_mm"]), table.find_column(["et0_mm"])
    if rain is None:
        raise RequestError(f"{label} has no column rain_mm; give {RAIN_FORMAT}.")
    rows: list[tuple[float, float | None]] = []
    for row in range(len(table.rows)):
        rain_mm, own_mm = table.parse_amount(row, rain, MAX_RAIN_MM), None
        if et0 is not None and table.get_cell(row, et0):
            own_mm = table.parse_amount(row, et0, MAX_ET0_MM)
        rows.append((rain_mm, own_mm))
    return rows
