"""The strategies by name, and what each is for."""

from __future__ import annotations

from collections.abc import Callable

from strategies.formation import col_by_col, row_by_row
from strategies.job import Job
from strategies.separate import interleaved, split_field
from vehicle.missions import Plan

ROW_BY_ROW_OPTIMISED = "row-by-row-optimised"
STRATEGIES = {
    "row-by-row": "triangle formation; at the headland each row waits for the one before it",
    ROW_BY_ROW_OPTIMISED: "the same with waiting times optimised",
    "col-by-col": "triangle formation; leader, then one side, then the other side turn one after another",
    "split-field": "one block of neighbouring tracks per tractor",
    "interleaved": "tractors take every n-th track, one behind the other",
}
FORMATIONS = ("row-by-row", ROW_BY_ROW_OPTIMISED, "col-by-col")


def build(name: str, job: Job, jump: int | None = None) -> Plan:
    """The plan of a strategy for a job. The optimised queue needs simulation and is made in planner.waiting.

    `jump` fixes the pattern of tracks of a split field. Raises StrategyError when the strategy cannot work this field
    with this fleet.
    """
    builders: dict[str, Callable[[Job], Plan]] = {
        "row-by-row": lambda job: row_by_row(job).plan,
        "col-by-col": lambda job: col_by_col(job).plan,
        "split-field": lambda job: split_field(job, jump),
        "interleaved": interleaved,
    }
    return builders[name](job)
