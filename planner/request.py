"""What is asked of a plan in the words of the command line and the service: texts and km/h, read into a scenario."""

from __future__ import annotations

from dataclasses import dataclass

from planner.errors import ScenarioError, named
from planner.scenario import (
    KMH,
    Scenario,
    parse_cell_bearings,
    parse_clock,
    parse_counts,
    parse_place,
    parse_strategies,
)


@dataclass(frozen=True)
class PlanRequest:
    """The options of `headland plan` that say what is planned, by the names and with the defaults they have there.

    Widths and headlands are in metres, bearings in degrees clockwise from north, prices in the farm's currency and
    times of day `hh:mm`; `tractors` is 3, 1-6 or 1,3,5 and `strategies` a list with commas, or all.
    """

    tractors: str = "1-6"
    strategies: str = "all"
    turn: str = "auto"
    start: str | None = None
    before: str | None = None
    price_per_hour: float = 40.0
    price_per_tractor: float = 0.0
    speed_kmh: float = 5.0
    turn_speed_kmh: float | None = None
    headland: float | None = None
    operation: str = "till"
    headland_first: bool = False
    headland_last: bool = False
    corners: str = "square"
    tracks_only: bool = False
    bearing: float | None = None
    cell_bearing: list[str] | None = None
    radius: float | None = None
    clearance: float = 0.5
    margin: float = 0.3
    entrance: str | None = None
    tractor: str = "eg105"
    draws: int | None = None
    rain: str | None = None
    refill: str | None = None
    prefer: str | None = None
    budget: float | None = None
    seed: int = 1
    gnss: bool = False
    gnss_table: str | None = None
    local: bool = False

    def scenario(self, field: str, width_m: float, shift_s: int | None = None) -> Scenario:
        """The scenario of one field and one width; the work starts at `shift_s`, seconds of the day, if not said.

        Raises ScenarioError for the first value that makes no sense.
        """
        start_s = shift_s if self.start is None else parse_clock(self.start, "start_s")
        return Scenario(
            field=field,
            local=self.local,
            width_m=width_m,
            headland_m=self.headland,
            bearing_deg=self.bearing,
            cell_bearings=parse_cell_bearings(self.cell_bearing or []),
            radius_m=self.radius,
            clearance_m=self.clearance,
            margin_m=self.margin,
            tractor=self.tractor,
            tractors=parse_counts(self.tractors),
            strategies=parse_strategies(self.strategies),
            turn=self.turn,
            speed_mps=self.speed_kmh * KMH,
            turn_speed_mps=None if self.turn_speed_kmh is None else self.turn_speed_kmh * KMH,
            price_per_hour=self.price_per_hour,
            price_per_tractor=self.price_per_tractor,
            start_s=start_s,
            before_s=None if self.before is None else parse_clock(self.before, "before_s"),
            seed=self.seed,
            gnss=self.gnss or self.gnss_table is not None,
            gnss_table=self.gnss_table,
            operation=self.operation,
            headland_order=headland_order(self.headland_first, self.headland_last),
            corners=self.corners,
            tracks_only=self.tracks_only,
            draws=self.draws,
            rain=self.rain,
            prefer=self.prefer,
            refill=self.refill,
            entrance=None if self.entrance is None else parse_place(self.entrance, "entrance"),
            budget=self.budget,
        )


def headland_order(first: bool, last: bool) -> str | None:
    """When the headland is to be worked, None where it was left open; refuses both at once."""
    if first and last:
        raise ScenarioError(
            f"{named('headland_first')} and {named('headland_last')} exclude each other; leave out one of them."
        )
    return "first" if first else "last" if last else None
