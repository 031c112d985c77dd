"""Results of the fleet study: the tables and claims of the thesis beside what was simulated."""

from __future__ import annotations

from dataclasses import dataclass

from reports.common.notebook import ShownResult


@dataclass(frozen=True)
class ThesisTableRow:
    """One row of a table of the thesis beside the simulated time."""

    label: str
    tractors: int
    thesis_s: float
    time_s: float | None
    difference_pct: float | None
    note: str = ""


@dataclass(frozen=True)
class ThesisClaim:
    """A claim of the thesis, and whether the simulation confirms it."""

    claim: str
    holds: bool
    why: str


@dataclass(frozen=True, repr=False)
class FleetStudy(ShownResult):
    """Tables 6.1 to 6.3 beside the thesis, its claims, and the one set of assumptions behind every row."""

    tables: dict[str, tuple[ThesisTableRow, ...]]
    claims: tuple[ThesisClaim, ...]
    assumptions: tuple[str, ...]
