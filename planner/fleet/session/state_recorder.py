"""Records the states of tractors, and writes them as logs with the columns of diagnosis."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

from fields.units import MINUTE_S
from planner.fleet.model.rules import STATE_PERIOD_S, FleetManagerError
from planner.fleet.session.inbound_frames import StateFrame

COLUMNS = (
    "time_s", "easting_m", "northing_m", "heading_deg", "speed_mps", "speed_command_mps", "steering_command_deg",
    "steering_deg", "shuttle", "implement",
)  # fmt: skip
ROW_COLUMNS = ("sequence", *COLUMNS, "leg", "leg_m", "mode")
TIME_COLUMN, SHUTTLE_COLUMN = ROW_COLUMNS.index("time_s"), ROW_COLUMNS.index("shuttle")
COMMAND_COLUMNS = ROW_COLUMNS.index("speed_command_mps"), ROW_COLUMNS.index("steering_command_deg")
StateRow = list[Any]

FRAME_GAP_S = 0.4  # between two frames, beyond which the commands in between are unknown
MOST_WAITING_STATES = round(5.0 * MINUTE_S / STATE_PERIOD_S)  # per tractor, that wait for a database
MOST_SEQUENCES_AHEAD = 10_000_000  # by which a sequence may be ahead of the last: eleven days at 10 Hz


def build_row(state: StateFrame, since_s: float) -> StateRow:
    """A state as a row; its time is of the simulated clock, from the start of the recording on."""
    return [
        state.sequence,
        round(since_s, 3),
        round(state.easting_m, 4),
        round(state.northing_m, 4),
        round(state.heading_deg, 3),
        round(state.speed_mps, 4),
        round(abs(state.speed_command_mps), 4),
        round(state.steering_command_deg, 3),
        None if state.steering_deg is None else round(state.steering_deg, 3),
        state.shuttle,
        state.implement,
        state.leg,
        round(state.leg_m, 3),
        state.mode,
    ]


class StateRecorder:
    """Rows that wait to be saved, and the last saved sequence, by tractor.

    While the database cannot be reached only the newest rows are kept; `lost` counts those dropped.
    """

    def __init__(self, fleet: str, tractors: int) -> None:
        self.fleet = fleet
        self.waiting: list[list[StateRow]] = [[] for _ in range(tractors)]
        self.received = [-1] * tractors
        self.saved = [-1] * tractors
        self.lost = 0

    def add(self, number: int, row: StateRow) -> None:
        """Add a row of a tractor, with a higher sequence than all before."""
        self.waiting[number].append(row)
        self.received[number] = row[0]
        self._drop_oldest(number)

    def check_state_sequence(self, number: int, state: StateFrame) -> None:
        """Raise FleetManagerError for a sequence so far ahead that later states would all seem repeated."""
        last = self.received[number]
        if state.sequence > last + MOST_SEQUENCES_AHEAD:
            raise FleetManagerError(
                f"The sequence {state.sequence} is too far ahead of the last, {last}; continue from last_sequence of "
                f"the welcome, at most {MOST_SEQUENCES_AHEAD} ahead.",
                parameter="sequence",
            )

    def take_waiting_rows(self) -> list[tuple[int, list[StateRow]]]:
        """Take the waiting rows, to save them."""
        taken = [(number, rows) for number, rows in enumerate(self.waiting) if rows]
        for number, _ in taken:
            self.waiting[number] = []
        return taken

    def mark_saved(self, taken: Sequence[tuple[int, list[StateRow]]]) -> None:
        """Mark rows as saved."""
        for number, rows in taken:
            self.saved[number] = rows[-1][0]

    def put_back(self, taken: Sequence[tuple[int, list[StateRow]]]) -> None:
        """Put rows back that could not be saved."""
        for number, rows in taken:
            self.waiting[number] = rows + self.waiting[number]
            self._drop_oldest(number)

    def _drop_oldest(self, number: int) -> None:
        """Drop the oldest rows if there are too many."""
        excess = len(self.waiting[number]) - MOST_WAITING_STATES
        if excess > 0:
            del self.waiting[number][:excess]
            self.lost += excess


def select_rising_rows(rows: Iterable[StateRow]) -> list[StateRow]:
    """Rows with increasing sequence and time; repeated ones are left out."""
    selected: list[StateRow] = []
    for row in rows:
        if not selected or (row[0] > selected[-1][0] and row[1] > selected[-1][1]):
            selected.append(row)
    return selected


def average_commands(rows: Sequence[StateRow]) -> list[StateRow]:
    """Rows for a diagnosis, which assumes that the commands of a row hold until the next row.

    A frame has the commands at the time it is sent; those of the next frame took effect somewhere in between. The mean
    of both is used. Over gaps and changes of direction rows are unchanged.
    """
    rising_rows = select_rising_rows(rows)
    averaged = [list(row) for row in rising_rows]
    for row, present, following in zip(averaged, rising_rows[:-1], rising_rows[1:], strict=False):
        if (
            following[TIME_COLUMN] - present[TIME_COLUMN] <= FRAME_GAP_S
            and following[SHUTTLE_COLUMN] == present[SHUTTLE_COLUMN]
        ):
            for column in COMMAND_COLUMNS:
                row[column] = round(0.5 * (present[column] + following[column]), 4)
    return averaged


def format_log_csv(rows: Sequence[StateRow]) -> str:
    """Rows as a measured log (CSV)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in select_rising_rows(rows):
        writer.writerow(["" if value is None else value for value in row[1 : 1 + len(COLUMNS)]])
    return text.getvalue()
