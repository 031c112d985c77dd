"""Checks of a request beyond the limits of single numbers: fleet, places, speeds, headland, bearings and times."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from fields.units import DAY_S, MPS_PER_KMH
from planner.errors import HeadlandError, RequestError, mark_parameter, shorten_value
from planner.request.option_texts import MAX_TRACTORS, format_clock
from planner.request.recent_rain import is_rain_table, parse_recent_rain
from strategies.path_planning.turn_kinds import HEADLAND_FIRST

if TYPE_CHECKING:
    from strategies.lines.line_wishes import LineWishes

FULL_CIRCLE_DEG = 360.0
MAX_SAMPLES = 1_000_000
MIN_CERTAINTY_PCT, MAX_CERTAINTY_PCT = 50.0, 99.0


def check_fleet(tractors: tuple[int, ...], strategies: tuple[str, ...]) -> None:
    """Raise RequestError for no or too many tractors, and for no, unknown or broken strategies."""
    from strategies.registry import STRATEGIES, get_strategy

    if not tractors:
        raise RequestError(f"No tractor count is given in {mark_parameter('tractors')}; use for instance 1 to 6.")
    for count in tractors:
        if not 1 <= count <= MAX_TRACTORS:
            raise RequestError(f"{count} tractors cannot be planned; use 1 to {MAX_TRACTORS}.", parameter="tractors")
    if not strategies:
        strategy_list = ", ".join(STRATEGIES)
        raise RequestError(f"No strategy is given; use one or more of: {strategy_list}.", parameter="strategies")
    try:
        for name in strategies:
            get_strategy(name)
    except HeadlandError as refusal:
        raise RequestError(str(refusal), parameter="strategies") from refusal


def check_places(entrance: tuple[float, float] | None, obstacles: Iterable[str], ignored: Iterable[str]) -> None:
    """Raise HeadlandError for an entrance or obstacle that is not a place, and for an empty name to ignore."""
    if entrance is not None and not all(map(math.isfinite, entrance)):
        raise RequestError(
            f"{mark_parameter('entrance')} is {shorten_value(entrance)}; give two numbers, longitude and latitude."
        )
    if obstacles:
        from fields.geometry.chosen_places import parse_obstacle_place

        for text in obstacles:
            parse_obstacle_place(text)
    if any(not name.strip() for name in ignored):
        raise RequestError(f"{mark_parameter('ignored')} is empty; give the name or number of an obstacle.")


def check_speeds(speed_mps: float, least_mps: float | None, greatest_mps: float | None) -> None:
    """Raise RequestError for a working speed beyond the limits of the implement."""
    limits = (("least", "min_speed_mps", least_mps), ("greatest", "max_speed_mps", greatest_mps))
    for wording, name, limit_mps in limits:
        if limit_mps is not None and (speed_mps < limit_mps if wording == "least" else speed_mps > limit_mps):
            raise RequestError(
                f"The working speed ({mark_parameter('speed_mps')}) is {speed_mps / MPS_PER_KMH:.3g} km/h, and the "
                f"{wording} of the implement ({mark_parameter(name)}) is {limit_mps / MPS_PER_KMH:.3g} km/h; change "
                "one of them.",
                parameter="speed_mps",
            )


def check_layout(request: Any) -> None:
    """Raise RequestError for wishes on headland and tracks of a PlanRequest that exclude each other.

    A headland is left or worked, and given in metres or in passes; where it is left nobody comes in by an entrance.
    Tracks have one kind of bearing, within a full circle, and along contours none of their own, and a worked headland.
    """
    if request.no_headland and request.headland_order is not None:
        raise RequestError(
            f"{mark_parameter('no_headland')} leaves the headland, and {mark_parameter('headland_order')} says when to "
            "work it; leave out one of them."
        )
    if request.no_headland and request.entrance is not None:
        raise RequestError(
            f"{mark_parameter('no_headland')} plans work on tracks alone, and {mark_parameter('entrance')} says where "
            "tractors come in; leave out one of them."
        )
    if request.headland_passes is not None and (request.no_headland or request.headland_m):
        is_left = request.no_headland
        name, meaning = ("no_headland", "leaves the headland") if is_left else ("headland_m", "is its depth")
        raise RequestError(
            f"{mark_parameter(name)} {meaning}, and {mark_parameter('headland_passes')} says in how many passes it is "
            "worked; leave out one of them."
        )
    for cell, bearing_deg in request.cell_bearings:
        if not abs(bearing_deg) <= FULL_CIRCLE_DEG:
            raise RequestError(
                f"The bearing of cell {cell} ({mark_parameter('cell_bearings')}) is {shorten_value(bearing_deg)}; "
                f"use {-FULL_CIRCLE_DEG:g} to {FULL_CIRCLE_DEG:g} degrees."
            )
    if request.guidance_line is not None and (request.cell_bearings or request.bearing_deg is not None):
        conflicting = "cell_bearings" if request.cell_bearings else "bearing_deg"
        raise RequestError(
            f"{mark_parameter('guidance_line')} is a bearing, and so is {mark_parameter(conflicting)}; leave out one "
            "of them."
        )
    if request.cell_bearings and request.bearing_deg is not None:
        raise RequestError(
            f"{mark_parameter('bearing_deg')} is for all cells, {mark_parameter('cell_bearings')} for one; leave out "
            "one of them."
        )
    swaths = request.swaths
    for name in ("bearing_deg", "cell_bearings", "guidance_line", "no_headland"):
        if swaths != "straight" and getattr(request, name) not in (None, (), False):
            raise RequestError(
                f"{mark_parameter('swaths')} {swaths} takes its direction from the ground and needs a worked headland; "
                f"leave out {mark_parameter(name)}.",
                parameter="swaths",
            )


def check_times(start_s: int | None, deadline_s: int | None) -> None:
    """Raise RequestError for clock times outside of a day, and for a deadline without a start."""
    for name, time_s in (("start_s", start_s), ("deadline_s", deadline_s)):
        if time_s is not None and not 0 <= time_s < DAY_S:
            raise RequestError(f"{mark_parameter(name)} is {time_s:g}; give seconds of the day, from 0 to {DAY_S - 1}.")
    if deadline_s is not None and start_s is None:
        raise RequestError(
            f"The deadline {mark_parameter('deadline_s')} needs a start; give {mark_parameter('start_s')} as well.",
            parameter="start_s",
        )
    if deadline_s is not None and deadline_s == start_s:
        raise RequestError(
            f"The deadline {format_clock(deadline_s)} is the start itself; give another {mark_parameter('deadline_s')}."
        )


def check_samples(request: Any) -> None:
    """Raise RequestError for no samples where something is judged by them alone."""
    for name in ("rain", "objective", "budget"):
        if request.samples == 0 and getattr(request, name) is not None:
            raise RequestError(
                f"{mark_parameter('samples')} is 0, and {mark_parameter(name)} is judged by samples; give 1 or more, "
                "or leave out one of them."
            )


def check_day_options(samples: int, certainty_pct: float | None) -> None:
    """Raise RequestError for a number of samples or a certainty that a day cannot be planned with."""
    if certainty_pct is not None and not MIN_CERTAINTY_PCT <= certainty_pct <= MAX_CERTAINTY_PCT:
        raise RequestError(
            f"{mark_parameter('certainty')} is {certainty_pct:g}; use {MIN_CERTAINTY_PCT:g} to {MAX_CERTAINTY_PCT:g} "
            "percent."
        )
    if not 1 <= samples <= MAX_SAMPLES:
        raise RequestError(f"{mark_parameter('samples')} is {samples}; use 1 to {MAX_SAMPLES}.")


def check_demo_options(
    demo: bool,
    logs: Sequence[str] | None,
    conversions: Mapping[str, object],
    own: Mapping[str, object],
    as_driven: bool,
) -> None:
    """Raise RequestError for both or neither of logs and a demonstration, and for an option that would be ignored.

    `conversions` are of log files, by what they are called; `own` are those of the demonstration, by parameter.
    """
    if demo == bool(logs):
        raise RequestError(f"Give either log files or {mark_parameter('demo')}.")
    for name, value in conversions.items():
        if demo and value:
            raise RequestError(f"{name} converts log files; leave it out with {mark_parameter('demo')}.")
    if demo and as_driven:
        raise RequestError(
            f"{mark_parameter('as_driven')} takes the size from log files; leave it out with {mark_parameter('demo')}."
        )
    for name, value in own.items():
        if value is not None and not demo:
            raise RequestError(
                f"{mark_parameter(name)} {value} needs the demonstration; add {mark_parameter('demo')} or leave out "
                f"{mark_parameter(name)}."
            )


def check_ground(soil: str | None, moisture_pct: float | None, rain_mm: str | None, et0_mm: float | None) -> None:
    """Raise RequestError for moisture or rain of no soil, and for rain that is none; a file is read later."""
    for name, value in (("moisture_pct", moisture_pct), ("rain_mm", rain_mm)):
        if value is not None and soil is None:
            raise RequestError(f"{mark_parameter(name)} is of a soil; name that with {mark_parameter('soil')} as well.")
    if rain_mm is None and et0_mm is not None:
        raise RequestError(
            f"{mark_parameter('et0_mm')} is of the days with {mark_parameter('rain_mm')}; give that as well."
        )
    if rain_mm is not None and not is_rain_table(rain_mm):
        parse_recent_rain(rain_mm)


def check_first_lines(wishes: LineWishes, headland_orders: Sequence[str]) -> None:
    """Raise HeadlandError for a line that is to come first where the only order of the headland needs the other."""
    from vehicle.missions.plan import HEADLAND_PASS

    if len(headland_orders) != 1:
        return
    is_headland_first = headland_orders[0] == HEADLAND_FIRST
    late = next((name for name in wishes.first if (name.kind == HEADLAND_PASS) != is_headland_first), None)
    if late is not None:
        before = "headland" if is_headland_first else "tracks"
        raise HeadlandError(
            f"{mark_parameter('work_first')} names {late}, and this operation has to work the {before} first; "
            f"leave out {late}, or change {mark_parameter('operation')}.",
            parameter="work_first",
        )
