"""The pair of files of an ISO 11783-10 time log: a header (XML) that names columns, and binary records.

A record has the time of day (ms), the day since 1980-01-01, those parts of the position that the header leaves empty,
and a count of values that changed, each a column and a number of 32 bits. A value stands until the next change.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from datetime import date, timedelta

import numpy as np

from fields.formats.markup import root_of
from planner.works.record import Array
from vehicle.measured.errors import LogError

_POSITION = (("A", "i"), ("B", "i"), ("C", "i"), ("D", "B"), ("E", "H"), ("F", "H"), ("G", "B"), ("H", "I"), ("I", "H"))
DAY_S = 86_400.0
DEGREE = 1e-7
FIRST_DAY = date(1980, 1, 1)
MOST_COLUMNS = 255


@dataclass(frozen=True, eq=False)
class TimeLog:
    """Records of one time log, whatever they say.

    Attributes:
        columns: DDI as four hexadecimal digits, and device element, of every column.
        time_s: (n,) seconds since 1980-01-01.
        lat, lon: (n,) degrees, NaN where the log has none.
        fix: (n,) status of the position, 0 for none, NaN where the log does not say.
        values: (n, columns), NaN before the first value.
        lost_bytes: behind the last record that is whole.
    """

    columns: tuple[tuple[str, str], ...]
    time_s: Array
    lat: Array
    lon: Array
    fix: Array
    values: Array
    lost_bytes: int

    def of(self, ddi: str) -> list[int]:
        """Columns with a DDI."""
        return [place for place, (name, _) in enumerate(self.columns) if name == ddi]


def read_time_log(header: bytes, records: bytes, label: str) -> TimeLog:
    """A time log from the contents of its two files; raises FieldError or LogError where the header is of no use."""
    time = root_of(header, f"{label}.xml")
    if time.tag != "TIM":
        time = next(time.iter("TIM"), time)
    position = time.find("PTN")
    given = {} if position is None else dict(position.attrib)
    parts = [(key, kind) for key, kind in _POSITION if given.get(key) == ""]
    columns = tuple((each.get("A", "").upper().zfill(4), each.get("C", "")) for each in time.iter("DLV"))
    if len(columns) > MOST_COLUMNS:
        raise LogError(f"{label}.xml names {len(columns)} columns and a time log has {MOST_COLUMNS} at most.")
    heads, values, lost = _records(records, "<IH" + "".join(kind for _, kind in parts), len(columns))
    table = {key: heads[:, 2 + place] for place, (key, _) in enumerate(parts)}
    empty = np.full(len(heads), np.nan)
    return TimeLog(
        columns, heads[:, 1] * DAY_S + heads[:, 0] / 1e3, table.get("A", empty / DEGREE) * DEGREE,
        table.get("B", empty / DEGREE) * DEGREE, table.get("D", empty), values, lost,
    )  # fmt: skip


def _records(data: bytes, form: str, columns: int) -> tuple[Array, Array, int]:
    """Heads (n, parts) and values (n, columns) of the records that are whole, and the bytes behind them."""
    head, change = struct.Struct(form), struct.Struct("<Bi")
    size, place = head.size, 0
    heads, rows, now = [], [], np.full(columns, np.nan)
    while place + size < len(data):
        count = data[place + size]
        end = place + size + 1 + change.size * count
        if end > len(data):
            break
        changes = list(change.iter_unpack(data[place + size + 1 : end]))
        if any(index >= columns for index, _ in changes):
            break  # out of step: what follows is no record
        heads.append(head.unpack_from(data, place))
        for index, value in changes:
            now[index] = value
        rows.append(now.copy())
        place = end
    parts = len(head.unpack(bytes(size)))
    table = np.array(heads, dtype=np.float64).reshape(len(heads), parts)
    return table, np.array(rows, dtype=np.float64).reshape(len(rows), columns), len(data) - place


def moment(seconds: float) -> str:
    """Seconds since 1980 as "2020-01-02T17:30:20"; "" where that is no day of a calendar."""
    day, rest = divmod(round(seconds), int(DAY_S))
    try:
        when = FIRST_DAY + timedelta(days=day)
    except OverflowError:
        return ""
    return f"{when.isoformat()}T{rest // 3600:02d}:{rest // 60 % 60:02d}:{rest % 60:02d}"
