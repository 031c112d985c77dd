"""What tractors reported: collected, kept by the second, and given out as logs in the columns of diagnosis."""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Iterable, Sequence
from typing import Any

from planner.service.errors import ServiceError
from planner.service.links.frames import State
from planner.service.store import Store

COLUMNS = (
    "time_s", "easting_m", "northing_m", "heading_deg", "speed_mps", "speed_command_mps", "steering_command_deg",
    "steering_deg", "shuttle", "implement",
)  # fmt: skip
KEPT = ("sequence", *COLUMNS, "leg", "leg_m", "mode")
TIME, SHUTTLE = KEPT.index("time_s"), KEPT.index("shuttle")
COMMANDS = KEPT.index("speed_command_mps"), KEPT.index("steering_command_deg")
GAP_S = 0.4  # between two frames, beyond which nobody knows what was commanded in between
OLDEST_S, AHEAD_S = 900.0, 2.0  # of the time of a state, by the clock here
ZIP_TIME = (1980, 1, 1, 0, 0, 0)
Row = list[Any]


def check_time(state: State, clock_s: float) -> None:
    """Refuse a state whose time cannot be by a clock that is right; `clock_s` is now, in seconds since 1970.

    States that waited for a link are old, but only so old. Raises ServiceError.
    """
    age_s = clock_s - state.time.timestamp()
    if not -AHEAD_S <= age_s <= OLDEST_S:
        told = f"{age_s:.0f} s ago" if age_s > 0.0 else f"{-age_s:.0f} s from now"
        raise ServiceError(
            f"The time of the state, {state.time.isoformat()}, is {told}; set the clock of the tractor: it may be "
            f"{OLDEST_S:g} s ago and {AHEAD_S:g} s ahead at most.",
            parameter="time",
        )


def row_of(state: State, begin_s: float, times: float) -> Row:
    """A state as a row; times are of the simulated clock, from `begin_s` (seconds since 1970) on."""
    return [
        state.sequence, round((state.time.timestamp() - begin_s) * times, 3), round(state.easting_m, 4),
        round(state.northing_m, 4), round(state.heading_deg, 3), round(state.speed_mps, 4),
        round(abs(state.speed_command_mps), 4), round(state.steering_command_deg, 3),
        None if state.steering_deg is None else round(state.steering_deg, 3), state.shuttle, state.implement,
        state.leg, round(state.leg_m, 3), state.mode,
    ]  # fmt: skip


MOST_AHEAD = 10_000_000  # sequences that one may be ahead of the last: eleven days of states at 10 Hz


class Recorder:
    """Rows that wait to be kept, and the sequence up to which they are kept, by tractor."""

    def __init__(self, fleet: str, tractors: int) -> None:
        self.fleet = fleet
        self.waiting: list[list[Row]] = [[] for _ in range(tractors)]
        self.seen = [-1] * tractors
        self.kept = [-1] * tractors

    def add(self, number: int, row: Row) -> None:
        """A row of a tractor, whose sequence is higher than all before."""
        self.waiting[number].append(row)
        self.seen[number] = row[0]

    def check(self, number: int, state: State) -> None:
        """Raise ServiceError for a sequence so far ahead that it is a fault: none below it would be heard again."""
        last = self.seen[number]
        if state.sequence > last + MOST_AHEAD:
            raise ServiceError(
                f"The sequence {state.sequence} is too far ahead of the last, {last}; go on from the last_sequence of "
                f"the welcome, at most {MOST_AHEAD} ahead.", parameter="sequence",
            )  # fmt: skip

    def take(self) -> list[tuple[int, list[Row]]]:
        """What waits, to be given to `keep`."""
        taken = [(number, rows) for number, rows in enumerate(self.waiting) if rows]
        for number, _ in taken:
            self.waiting[number] = []
        return taken

    def done(self, taken: Sequence[tuple[int, list[Row]]]) -> list[tuple[int, int]]:
        """These are kept now; the tractors with the sequence that each may be told of."""
        for number, rows in taken:
            self.kept[number] = rows[-1][0]
        return [(number, self.kept[number]) for number, _ in taken]

    def back(self, taken: Sequence[tuple[int, list[Row]]]) -> None:
        """These could not be kept; they wait again."""
        for number, rows in taken:
            self.waiting[number] = rows + self.waiting[number]


def keep(store: Store, fleet: str, taken: Sequence[tuple[int, list[Row]]]) -> None:
    """Write rows into the store."""
    for number, rows in taken:
        store.add_recording(fleet, number, rows)


def rising(rows: Iterable[Row]) -> list[Row]:
    """Rows each of which has a higher sequence and a later time than the one before; those sent twice are left out."""
    kept: list[Row] = []
    for row in rows:
        if not kept or (row[0] > kept[-1][0] and row[1] > kept[-1][1]):
            kept.append(row)
    return kept


def holding(rows: Sequence[Row]) -> list[Row]:
    """Rows for a diagnosis, which takes the commands of a row to hold until the next one.

    A frame tells the commands that hold when it is sent: those of the next one came into force somewhere between the
    two. Half way is taken, that is, the mean of both until then. Over gaps and changes of direction rows stay as they
    are.
    """
    kept = rising(rows)
    held = [list(row) for row in kept]
    for row, now, after in zip(held, kept[:-1], kept[1:], strict=False):
        if after[TIME] - now[TIME] <= GAP_S and after[SHUTTLE] == now[SHUTTLE]:
            for column in COMMANDS:
                row[column] = round(0.5 * (now[column] + after[column]), 4)
    return held


def log_csv(rows: Sequence[Row]) -> str:
    """Rows as a measured log."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rising(rows):
        writer.writerow(["" if value is None else value for value in row[1 : 1 + len(COLUMNS)]])
    return text.getvalue()


def zipped(logs: Sequence[tuple[str, str]]) -> bytes:
    """Named texts as a zip file; the same texts give the same bytes."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in logs:
            archive.writestr(zipfile.ZipInfo(name, ZIP_TIME), text, zipfile.ZIP_DEFLATED)
    return data.getvalue()
