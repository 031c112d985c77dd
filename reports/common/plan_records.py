"""Records that results of plans are made of: what keeps plans from being recommended, faults, places, drives and legs.

All are plain frozen data, as the planner hands them to the reports.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from fields.arrays import Floats, Integers
from reports.common.rendering import ShownResult

ShortfallKind = Literal["pull", "worked", "rain", "budget", "late"]

OBSTACLE, FENCE, OUTLINE, STUCK = "obstacle", "fence", "outline", "stuck"


@dataclass(frozen=True)
class Shortfall:
    """What the best plan lacks of what was asked for; kinds are listed in the order in which they are said.

    `sentence` says so in English. Reports word pull and late from the figures of the ranking: for pull it is "", for
    late what would help, if that is known.
    """

    kind: ShortfallKind
    sentence: str = ""


@dataclass(frozen=True)
class PullFigures:
    """What an implement needs at the drawbar, and what the tractor has there, by ASAE D497.

    Attributes:
        implement: what the table of drafts calls it, such as "cultivator" or "drill".
        depth_cm: working depth; None where the draft does not depend on it.
        draft_kn, needed_kw: of the implement at `speed_kmh`, in the soil of the plan, else in medium soil.
        engine_kw, available_kw: of the tractor, at the drawbar the latter.
        possible_width_m, possible_speed_kmh: the greatest that it can pull, the other being as asked for; None where
            nothing sensible is left.
        range_pct: how far drafts of such implements lie from the mean, either way.
        is_assumed: whether the implement is only the usual one of the operation.
    """

    implement: str
    width_m: float
    speed_kmh: float
    depth_cm: float | None
    draft_kn: float
    needed_kw: float
    engine_kw: float
    available_kw: float
    possible_width_m: float | None
    possible_speed_kmh: float | None
    range_pct: float
    is_assumed: bool = True

    @property
    def is_questioned(self) -> bool:
        """Whether the implement needs more than the tractor has."""
        return self.needed_kw > self.available_kw

    @property
    def is_infeasible(self) -> bool:
        """Whether even the lightest of such implements (`range_pct` below the mean) needs more than the tractor has."""
        return (1.0 - 0.01 * self.range_pct) * self.needed_kw > self.available_kw


@dataclass(frozen=True)
class UnworkedPiece:
    """A piece of unworked ground: its area, a place in it in metres of the field and in degrees, and why it is left.

    `lon` and `lat` are None for a field in local metres; the `reason` is "" where it is not known.
    """

    m2: float
    x_m: float
    y_m: float
    lon: float | None = None
    lat: float | None = None
    reason: str = ""


@dataclass(frozen=True)
class PlanFault:
    """Why and where a plan cannot be driven: a kind above, and the place in metres of the field.

    `number` is that of the obstacle (Field.solid_obstacles, then fences) that is touched.
    """

    kind: str
    number: int | None
    x_m: float
    y_m: float


@dataclass(frozen=True)
class SlopePlace:
    """A slope (percent) or a margin (degrees) at a place of a tractor, counted from 1: metres of the field and degrees.

    `lon` and `lat` are None for a field in local metres.
    """

    amount: float
    tractor: int
    x_m: float
    y_m: float
    lon: float | None = None
    lat: float | None = None


class Stake(IntEnum):
    """What a remark puts at stake, the worst first."""

    LIFE = 0
    GROUND_OF_OTHERS = 1
    MACHINES = 2
    WORK = 3
    TIME = 4
    NOTHING = 5


@dataclass(frozen=True)
class Remark:
    """A sentence without its full stop, and what it puts at stake."""

    stake: Stake
    text: str


@dataclass(frozen=True)
class DriverLeg:
    """One leg of a tractor: a row of the list for its driver.

    Attributes:
        kind: "track", "round" (one side of a headland pass), "corner" (between two sides), "turn" or "way" (to the next
            track or pass), "enter" (from the entrance), "leave" (back to it), "wait", "rest" (nothing to do), "drive",
            "refill-way" (to the service point), "fold" or "unfold" (of the implement), "refill" (of `amount`, below 0
            where a tank is emptied), or "charge" or "change" (of a battery, `amount` in kWh).
        number: of the track or headland pass, from 1; turns and ways have those of their goal.
        part: piece of a track ("a", "b", ...) or side of a pass ("1", "2", ...), "" where there is only one.
        is_headland_pass: whether `number` counts headland passes.
        continues: whether it continues after a wait.
        from_s, seconds, length_m: begin, duration and length; breaks and nights are no part of either time.
        bearing_deg: direction worked in, clockwise from north.
        over_swaths, shape: of a turn, how many tracks it leads over, and "u", "omega", "switch-back" or "".
        for_tractors: numbers, from 1, of the tractors that are waited for.
        reversing_m: metres of it in reverse.
        over_finished: names of the tracks, and "headland", of finished ground that it leads over; `over_finished_m`:
            metres on it.
        over_standing, over_standing_m: the same of a crop that still stands, where one does.
        x_m, y_m: the place half way along it.
        fuel_l, energy_kwh: used on it; None where not known.
        slope_along_pct, slope_across_pct: the steepest on it, positive uphill and where the ground
            falls to the right; None without heights.
        delay_s: what precedes it besides field work, seconds: the road, breaks; pause_s: breaks and nights in it.
    """

    kind: str
    number: int | None
    part: str
    from_s: float
    seconds: float
    length_m: float
    x_m: float
    y_m: float
    is_headland_pass: bool = False
    continues: bool = False
    bearing_deg: float | None = None
    over_swaths: int | None = None
    shape: str = ""
    for_tractors: tuple[int, ...] = ()
    amount: float | None = None
    reversing_m: float = 0.0
    over_finished: tuple[str, ...] = ()
    over_finished_m: float = 0.0
    over_standing: tuple[str, ...] = ()
    over_standing_m: float = 0.0
    fuel_l: float | None = None
    energy_kwh: float | None = None
    slope_along_pct: float | None = None
    slope_across_pct: float | None = None
    delay_s: float = 0.0
    pause_s: float = 0.0

    @property
    def clock_s(self) -> float:
        """Its begin, seconds after the start of the plan, by the clock."""
        return self.from_s + self.delay_s


@dataclass(frozen=True, eq=False)
class HeadlandPassLine:
    """A headland pass or a side of one: the number of the pass from 1, the centre line (n, 2) in metres, closed if the
    first point is repeated, and its name."""

    number: int
    points: Floats
    name: str = ""


@dataclass(frozen=True, eq=False)
class CellOutline:
    """A cell of the field: number from 1, bearing of its tracks, rings (n, 2) and a place inside, metres."""

    number: int
    bearing_deg: float
    rings: tuple[Floats, ...]
    x_m: float
    y_m: float


@dataclass(frozen=True, eq=False)
class Relief:
    """Heights of a field to draw.

    `shade` (rows from south to north, columns from west to east) is the brightness from 0 to 1 of pixels that cover
    west, south, east and north `bounds_m`; `contours` are heights and lines (n, 2) in metres, `interval_m` apart.
    """

    shade: Floats
    bounds_m: tuple[float, float, float, float]
    contours: tuple[tuple[float, Floats], ...]
    interval_m: float

    @property
    def label(self) -> str:
        """What a legend calls it."""
        return f"contours every {self.interval_m:g} m"


@dataclass(frozen=True, eq=False, repr=False)
class PlanDrive(ShownResult):
    """The drive of all tractors of one plan, for pictures. Metres, rings and lines (n, 2).

    Attributes:
        boundary, holes: rings.
        swaths: centre lines (n, 2) each; `swath_names`: their names, by default their places from 1.
        xy, status: per tractor the guided point (t, 2) and its status (t,) every `step_s`: 0 finished, 1 working,
            2 turning, 3 waiting, 4 reversing, 5 refilling, 6 folding.
        seconds: per state (working, turning, waiting, reversing, and refilling and folding where there is any) one
            value per tractor.
        done: rings around ground that was worked before, in the same order.
        unworked: rings around unworked ground, counter-clockwise, and clockwise around worked ground inside it.
        largest_missed, missed_m2: the largest piece that is missed, and all that is.
        headland_passes: those that are worked, and `headland_sides`, their lines by name; headland_order: whether
            "first" or "last".
        cells: of a field that has several.
        obstacles, fences: rings, and lines along the outline.
        steps: the legs of each tractor, in order; `service`: what stops at the service point are for.
        cut_off: pieces of ground that obstacles cut off.
        worked_pct: share of the field that is worked.
        start: the time of day at which it starts (hh:mm); None if that is not known.
        stated_end_s: when its plan is done as every report states it; `has_delays`: with late starts, stops and
            breakdowns, which the drive has not. None for the end of the drive.
        fault_places: places (x, y) where plans cannot be driven.
        crs, origin_m: system and origin of the metres on the earth; None for local metres.
        relief: heights; None for level ground.
    """

    title: str
    boundary: Floats
    holes: tuple[Floats, ...]
    swaths: Sequence[Floats]
    width_m: float
    step_s: float
    xy: tuple[Floats, ...]
    status: tuple[Integers, ...]
    finish_s: tuple[float, ...]
    seconds: dict[str, tuple[float, ...]]
    entrance: tuple[float, float] | None = None
    unworked: tuple[Floats, ...] = ()
    done: tuple[Floats, ...] = ()
    largest_missed: UnworkedPiece | None = None
    missed_m2: float = 0.0
    swath_names: tuple[str, ...] = ()
    headland_passes: tuple[HeadlandPassLine, ...] = ()
    headland_sides: tuple[HeadlandPassLine, ...] = ()
    cells: tuple[CellOutline, ...] = ()
    obstacles: tuple[Floats, ...] = ()
    fences: tuple[Floats, ...] = ()
    steps: tuple[tuple[DriverLeg, ...], ...] = ()
    cut_off: tuple[UnworkedPiece, ...] = ()
    worked_pct: float | None = None
    stated_end_s: float | None = None
    has_delays: bool = False
    fault_places: tuple[tuple[float, float], ...] = ()
    crs: str | None = None
    origin_m: tuple[float, float] = (0.0, 0.0)
    relief: Relief | None = None
    headland_order: str | None = None
    service: str = "refill"
    start: str | None = None
