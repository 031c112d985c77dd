"""What the user asks for, validated before anything is simulated."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, fields
from numbers import Integral, Real
from pathlib import Path

from fields.reading import brief
from planner.errors import ScenarioError, named, nearest
from strategies.headland.rounds import FIRST, LAST, ORDERS
from strategies.registry import STRATEGIES
from strategies.ways.turns import TURN_KINDS

MOST_TRACTORS = 50
KMH = 1.0 / 3.6
SLOWEST_KMH, FASTEST_KMH = 0.5, 30.0
DEFAULT_SPEED_MPS = 5.0 * KMH  # thesis, section 6.3.1
TURNING_MPS = 5.0 * KMH  # faster, the wheels cannot be turned over in time for arcs near full lock
DAY_S = 24 * 3600
LONGEST_M = 1000.0  # wider, deeper and farther round than anything that works a field
WHOLE_TURN_DEG = 360.0
HIGHEST_PRICE = 1e9  # in whatever currency
LEAST_CLEARANCE_M, MOST_CLEARANCE_M = 0.05, 10.0
SOW = "sow"
ORDERS_OF = {"till": ORDERS, SOW: (LAST,), "spray": ORDERS, "harvest": (FIRST,), "mow": (FIRST,)}
"""When the headland may be worked: what goes out must not be driven over, what is sown not either."""
STANDING = ("harvest", "mow")  # what is there before it is worked is not to be driven through
CORNERS = ("square", "round")
MOST_MARGIN_M = 100.0
MOST_DRAWS = 1_000_000
FASTEST, CHEAPEST, SUREST = "fastest", "cheapest", "surest"
PREFERENCES = (FASTEST, CHEAPEST, SUREST)
DRAWN = ("rain", "prefer", "budget")  # what only draws tell
MOST_DIGITS = 40  # more are no number that anyone typed


_OR_NONE = " | None"
_KINDS: dict[str, tuple[tuple[type, ...], str]] = {
    "str": ((str, Path), "a text"),
    "bool": ((bool,), "True or False"),
    "int": ((Integral,), "a whole number"),
    "float": ((Real,), "a number"),
    "tuple[float, float]": ((tuple, list), "two numbers in a tuple"),
    "tuple[int, ...]": ((tuple, list, range), "whole numbers in a tuple"),
    "tuple[str, ...]": ((tuple, list), "names in a tuple"),
    "tuple[tuple[int, float], ...]": ((tuple, list), "pairs of a cell's number and degrees in a tuple"),
}


@dataclass(frozen=True)
class Scenario:
    """A field, a fleet and a question. Lengths in metres, speeds in m/s, clock times in seconds of the day.

    `field` and `tractor` are names or files. What is None is decided by planning: the headland by the turn that must
    fit it, the bearing by the least driving, the radius by full lock, the speed of turns by `turning_mps`. A deadline
    `before_s` that is earlier than `start_s` is on the next day. `clearance_m` is kept between machines with their
    implements; beside each other on neighbouring tracks they have what the tracks leave. `margin_m` is kept to
    obstacles and holes of the field. The headland is worked in rounds, "first" or "last" by `headland_order` (None: as
    the `operation` allows and is quicker), with square or round `corners`; with `tracks_only` it is left as room for
    turning. `cell_bearings` are pairs of a cell's number and its bearing in degrees clockwise from north. The
    `entrance` (longitude and latitude, or x and y of a field in local metres) takes the place of that of the field.

    `draws` are made of what varies from day to day (None: as many as usual where there is a deadline, rain, a
    preference or a budget, else none), `rain` says when it begins (planner.chance.rain), `prefer` is "fastest",
    "cheapest" or "surest", `budget` the most that may be paid. `refill` says where tanks are made good: "headland",
    "tender", or a place in degrees "lon,lat" (metres "x,y" for a field in local metres); None: at the place of the
    field file, else on the headland.

    `crs` names the coordinate system of a field file that does not, `swap` exchanges x and y of its numbers, and
    `along` is the name of a guidance line in it that takes the place of `bearing_deg`. Raises ScenarioError.
    """

    field: str = "iwamizawa"
    local: bool = False
    width_m: float = 3.0
    headland_m: float | None = None
    bearing_deg: float | None = None
    radius_m: float | None = None
    clearance_m: float = 0.5
    margin_m: float = 0.3
    tractor: str = "eg105"
    tractors: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    strategies: tuple[str, ...] = tuple(STRATEGIES)
    turn: str = "auto"
    speed_mps: float = DEFAULT_SPEED_MPS
    turn_speed_mps: float | None = None
    price_per_hour: float = 40.0
    price_per_tractor: float = 0.0
    start_s: int | None = None
    before_s: int | None = None
    seed: int = 1
    gnss: bool = False
    gnss_table: str | None = None
    operation: str = "till"
    headland_order: str | None = None
    corners: str = "square"
    tracks_only: bool = False
    draws: int | None = None
    rain: str | None = None
    prefer: str | None = None
    budget: float | None = None
    cell_bearings: tuple[tuple[int, float], ...] = ()
    refill: str | None = None
    entrance: tuple[float, float] | None = None
    crs: str | None = None
    swap: bool = False
    along: str | None = None

    def __post_init__(self) -> None:
        _check_types(self)
        _check_fleet(self)
        _check_names(self)
        _check_rounds(self)
        _check_lengths(self)
        _check_cells(self)
        _check_entrance(self)
        _check_speeds(self)
        _check_prices(self)
        _check_times(self)
        _check_draws(self)
        if self.gnss_table is not None and not self.gnss:
            raise ScenarioError(f"{named('gnss_table')} is used with {named('gnss')} alone; set that as well.")

    @property
    def turning_mps(self) -> float:
        """Speed in turns: as asked for, else that of work, at most what the wheels can be turned over for."""
        return min(self.speed_mps, TURNING_MPS) if self.turn_speed_mps is None else self.turn_speed_mps

    @property
    def headland_orders(self) -> tuple[str, ...]:
        """When the headland may be worked, "first" or "last"; nothing where it is not."""
        if self.tracks_only:
            return ()
        return ORDERS_OF[self.operation] if self.headland_order is None else (self.headland_order,)

    @property
    def allowed_s(self) -> float | None:
        """Seconds from start to deadline, None without a deadline; a clock that runs past midnight goes on."""
        if self.before_s is None or self.start_s is None:
            return None
        return float((self.before_s - self.start_s) % DAY_S)

    def told(self, after_s: float | None) -> str:
        """The clock so many seconds after the start, with the day where that is another one; "" without a clock."""
        return "" if self.start_s is None or after_s is None else later_clock(self.start_s, after_s)


def _check_types(scenario: Scenario) -> None:
    """Refuse what is not of the kind that the parameter says; a file may be a path."""
    for each in fields(scenario):
        value, kind = getattr(scenario, each.name), str(each.type)
        if value is None and kind.endswith(_OR_NONE):
            continue
        types, words = _KINDS[kind.removesuffix(_OR_NONE)]
        if not isinstance(value, types) or (isinstance(value, bool) and kind != "bool"):
            raise ScenarioError(f"{named(each.name)} is {brief(value)}; give {words}.")


def _check_fleet(scenario: Scenario) -> None:
    if not scenario.tractors:
        raise ScenarioError(f"No tractor count is given in {named('tractors')}; use for instance 1 to 6.")
    for count in scenario.tractors:
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST_TRACTORS:
            raise ScenarioError(f"{count} tractors cannot be planned; use 1 to {MOST_TRACTORS}.", parameter="tractors")


def _check_names(scenario: Scenario) -> None:
    known = ", ".join(STRATEGIES)
    if not scenario.strategies:
        raise ScenarioError(f"No strategy is given; use one or more of: {known}.", parameter="strategies")
    for name in scenario.strategies:
        if name not in STRATEGIES:
            raise ScenarioError(
                f"Strategy {name!r} is unknown{nearest(name, STRATEGIES)}; use one of: {known}.", parameter="strategies"
            )
    turns = ("auto", *TURN_KINDS)
    if scenario.turn not in turns:
        raise ScenarioError(
            f"Turn {scenario.turn!r} is unknown{nearest(scenario.turn, turns)}; use {', '.join(turns)}.",
            parameter="turn",
        )


def _check_rounds(scenario: Scenario) -> None:
    choices: tuple[tuple[str, str | None, tuple[str, ...]], ...] = (
        ("operation", scenario.operation, tuple(ORDERS_OF)),
        ("headland_order", scenario.headland_order, ORDERS),
        ("corners", scenario.corners, CORNERS),
    )
    for name, value, known in choices:
        if value not in known and (value is not None or name != "headland_order"):
            close = nearest(str(value), known)
            raise ScenarioError(f"{named(name)} {value!r} is unknown{close}; use {', '.join(known)}.", parameter=name)
    if scenario.tracks_only and scenario.headland_order is not None:
        raise ScenarioError(
            f"{named('tracks_only')} leaves the headland, and {named('headland_order')} says when to work it; "
            "leave out one of them."
        )


def _check_lengths(scenario: Scenario) -> None:
    positive = {
        f"working width ({named('width_m')})": scenario.width_m,
        f"headland ({named('headland_m')})": scenario.headland_m,
        f"turning radius ({named('radius_m')})": scenario.radius_m,
    }
    for name, value in positive.items():
        if value is not None and not value > 0:
            raise ScenarioError(f"The {name} is {value:g}; it must be above 0.")
        if value is not None and value > LONGEST_M:
            raise ScenarioError(f"The {name} is {value:g} m; use {LONGEST_M:g} m or less.")
    if not 0.0 <= scenario.margin_m <= MOST_MARGIN_M:
        raise ScenarioError(
            f"The margin to obstacles ({named('margin_m')}) is {scenario.margin_m:g} m; use 0 to {MOST_MARGIN_M:g} m."
        )
    if not LEAST_CLEARANCE_M <= scenario.clearance_m <= MOST_CLEARANCE_M:
        raise ScenarioError(
            f"The clearance between tractors ({named('clearance_m')}) is {scenario.clearance_m:g} m; use "
            f"{LEAST_CLEARANCE_M:g} to {MOST_CLEARANCE_M:g} m."
        )
    if scenario.bearing_deg is not None and not abs(scenario.bearing_deg) <= WHOLE_TURN_DEG:
        raise ScenarioError(
            f"The bearing ({named('bearing_deg')}) is {scenario.bearing_deg:g}; give degrees clockwise from north, at "
            f"most {WHOLE_TURN_DEG:g} either way."
        )


def _check_cells(scenario: Scenario) -> None:
    for pair in scenario.cell_bearings:
        if not (isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[0], int) and isinstance(pair[1], Real)):
            raise ScenarioError(f"{named('cell_bearings')} holds {brief(pair)}; give pairs of a cell and degrees.")
        if not abs(pair[1]) <= WHOLE_TURN_DEG:
            raise ScenarioError(
                f"The bearing of cell {pair[0]} ({named('cell_bearings')}) is {pair[1]:g}; give degrees clockwise from "
                f"north, at most {WHOLE_TURN_DEG:g} either way."
            )
    if scenario.along is not None and (scenario.cell_bearings or scenario.bearing_deg is not None):
        other = "cell_bearings" if scenario.cell_bearings else "bearing_deg"
        raise ScenarioError(f"{named('along')} is a bearing, and so is {named(other)}; leave out one of them.")
    if scenario.cell_bearings and scenario.bearing_deg is not None:
        raise ScenarioError(
            f"{named('bearing_deg')} is that of every cell, {named('cell_bearings')} of one; leave out one of them."
        )


def _check_entrance(scenario: Scenario) -> None:
    place = scenario.entrance
    if place is not None and not (len(place) == 2 and all(isinstance(v, Real) and math.isfinite(v) for v in place)):
        raise ScenarioError(f"{named('entrance')} is {brief(place)}; give two numbers, longitude and latitude.")


def _check_speeds(scenario: Scenario) -> None:
    speeds = {
        f"speed ({named('speed_mps')})": scenario.speed_mps,
        f"turn speed ({named('turn_speed_mps')})": scenario.turn_speed_mps,
    }
    for name, speed in speeds.items():
        if speed is None:
            continue
        kmh = speed / KMH
        if not speed > 0:
            raise ScenarioError(f"The {name} is {kmh:g} km/h; it must be above 0.")
        if kmh < SLOWEST_KMH * (1 - 1e-9):
            raise ScenarioError(
                f"The {name} of {kmh:g} km/h is slower than a tractor creeps; use {SLOWEST_KMH:g} km/h or more."
            )
        if kmh > FASTEST_KMH * (1 + 1e-9):
            raise ScenarioError(f"The {name} of {kmh:g} km/h is beyond field work; use {FASTEST_KMH:g} km/h or less.")


def _check_prices(scenario: Scenario) -> None:
    for name in ("price_per_hour", "price_per_tractor", "budget"):
        price = getattr(scenario, name)
        if price is None:
            continue
        if not price >= 0:
            raise ScenarioError(f"{named(name)} is {price:g}; a price must be 0 or more.")
        if price > HIGHEST_PRICE:
            raise ScenarioError(f"{named(name)} is {price:g}; use {HIGHEST_PRICE:g} or less.")


def _check_times(scenario: Scenario) -> None:
    """The seed and the clock."""
    if scenario.seed < 0:
        raise ScenarioError(f"The seed ({named('seed')}) is {scenario.seed}; use 0 or more.")
    for name in ("start_s", "before_s"):
        time = getattr(scenario, name)
        if time is not None and not 0 <= time < DAY_S:
            raise ScenarioError(f"{named(name)} is {time:g}; give seconds of the day, from 0 to {DAY_S - 1}.")
    if scenario.before_s is None:
        return
    if scenario.start_s is None:
        raise ScenarioError(
            f"The deadline {named('before_s')} needs a start; give {named('start_s')} as well.", parameter="start_s"
        )
    if scenario.before_s == scenario.start_s:
        raise ScenarioError(
            f"The deadline {clock(scenario.before_s)} is the start itself; give another {named('before_s')}."
        )


def _check_draws(scenario: Scenario) -> None:
    if scenario.draws is not None and not 0 <= scenario.draws <= MOST_DRAWS:
        raise ScenarioError(f"{named('draws')} is {scenario.draws}; use 0 to {MOST_DRAWS}.")
    if scenario.draws == 0 and (unused := next((name for name in DRAWN if getattr(scenario, name) is not None), None)):
        raise ScenarioError(
            f"{named('draws')} is 0, and {named(unused)} is judged by draws; give 1 or more, or leave out one of them."
        )
    if scenario.prefer is not None and scenario.prefer not in PREFERENCES:
        close = nearest(scenario.prefer, PREFERENCES)
        raise ScenarioError(
            f"{named('prefer')} {scenario.prefer!r} is unknown{close}; use {', '.join(PREFERENCES)}.",
            parameter="prefer",
        )


def clock(seconds: float) -> str:
    """Seconds of the day as hh:mm."""
    return f"{int(seconds) // 3600 % 24:02d}:{int(seconds) % 3600 // 60:02d}"


def later_clock(start_s: float, after_s: float) -> str:
    """ "17:00", "00:40 next day" or "07:10, 2 days later": the clock so many seconds after another."""
    days, time_s = divmod(start_s + after_s, DAY_S)
    return clock(time_s) + {0: "", 1: " next day"}.get(int(days), f", {int(days)} days later")


def parse_clock(text: str, parameter: str) -> int:
    """ "13:00" as seconds of the day; raises ScenarioError about the parameter it is meant for."""
    match = re.fullmatch(r"(\d{1,2}):(\d{2})", text.strip())
    if not match or int(match[1]) > 23 or int(match[2]) > 59:
        raise ScenarioError(f"{named(parameter)} {text!r} is not a time of day; write hh:mm, for instance 13:00.")
    return int(match[1]) * 3600 + int(match[2]) * 60


def parse_counts(text: str) -> tuple[int, ...]:
    """ "1-6", "3" or "1,3,5-7" as sorted counts; raises ScenarioError."""
    counts: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(rf"\s*(\d{{1,{MOST_DIGITS}}})\s*(?:-\s*(\d{{1,{MOST_DIGITS}}})\s*)?", part)
        if not match:
            text = text if len(text) <= MOST_DIGITS else text[:MOST_DIGITS] + "..."
            raise ScenarioError(f"{named('tractors')} {text!r} is not a count; write for instance 3, 1-6 or 1,3,5.")
        low, high = int(match[1]), int(match[2] or match[1])
        if low > high:
            raise ScenarioError(f"{named('tractors')} {part.strip()!r} runs backwards; write {high}-{low}.")
        if high > MOST_TRACTORS:
            raise ScenarioError(f"{high} tractors cannot be planned; use 1 to {MOST_TRACTORS}.", parameter="tractors")
        counts.update(range(low, high + 1))
    return tuple(sorted(counts))


def parse_widths(text: str) -> tuple[float, ...]:
    """ "3" or "3,6" as widths in metres, each once, in the order given; raises ScenarioError."""
    widths: dict[float, None] = {}
    for part in text.split(","):
        if not re.fullmatch(rf"\s*[-+]?(\d{{1,{MOST_DIGITS}}}(\.\d*)?|\.\d+)(e[-+]?\d{{1,3}})?\s*", part, re.I):
            raise ScenarioError(f"{named('width_m')} {brief(text)} is not a width; write metres, such as 3 or 3,6.")
        widths[float(part)] = None
    return tuple(widths)


def parse_cell_bearings(texts: Iterable[str]) -> tuple[tuple[int, float], ...]:
    """ "2=45" and more as cells and degrees, the last of a cell counts; raises ScenarioError."""
    bearings: dict[int, float] = {}
    for text in texts:
        match = re.fullmatch(rf"\s*(\d{{1,{MOST_DIGITS}}})\s*=\s*([-+]?\d{{1,{MOST_DIGITS}}}(?:\.\d*)?)\s*", text)
        if not match:
            raise ScenarioError(
                f"{named('cell_bearings')} {brief(text)} is not a cell with its bearing; write for instance 2=45."
            )
        bearings[int(match[1])] = float(match[2])
    return tuple(sorted(bearings.items()))


def parse_place(text: str, parameter: str) -> tuple[float, float]:
    """ "9.53,56.21" as two numbers; raises ScenarioError about the parameter it is meant for."""
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError:
        raise ScenarioError(
            f"{named(parameter)} {brief(text)} is no place; write longitude and latitude, for instance 9.53,56.21."
        ) from None
    return first, second


def parse_strategies(text: str) -> tuple[str, ...]:
    """ "all", or names separated by commas, each once and in the order given; Scenario refuses unknown ones."""
    if text.strip() == "all":
        return tuple(STRATEGIES)
    return tuple(dict.fromkeys(name.strip() for name in text.split(",")))
