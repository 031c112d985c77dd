"""Checks of a request beyond the limits of single numbers: fleet, places, speeds, headland, bearings and times."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

from planner.errors import HeadlandError, RequestError, mark_parameter, shorten_value
from planner.request.option_texts import DAY_S, MAX_TRACTORS, MPS_PER_KMH, format_clock
from planner.request.recent_rain import is_rain_table, parse_recent_rain

FULL_CIRCLE_DEG = 360.0
SAMPLED_PARAMETERS = ("rain", "objective", "budget")  # they are judged by samples alone


class RequestValues(Protocol):
    """The values of a plan request that are checked together."""

    @property
    def speed_mps(self) -> float: ...

    @property
    def min_speed_mps(self) -> float | None: ...

    @property
    def max_speed_mps(self) -> float | None: ...

    @property
    def no_headland(self) -> bool: ...

    @property
    def headland_order(self) -> str | None: ...

    @property
    def headland_passes(self) -> int | None: ...

    @property
    def bearing_deg(self) -> float | None: ...

    @property
    def cell_bearings(self) -> tuple[tuple[int, float], ...]: ...

    @property
    def guidance_line(self) -> str | None: ...

    @property
    def swaths(self) -> str: ...

    @property
    def operation(self) -> str: ...

    @property
    def width_m(self) -> float: ...

    @property
    def draft(self) -> str | None: ...

    @property
    def depth_cm(self) -> float | None: ...

    @property
    def soil(self) -> str | None: ...

    @property
    def moisture_pct(self) -> float | None: ...

    @property
    def rain_mm(self) -> str | None: ...

    @property
    def et0_mm(self) -> float | None: ...

    @property
    def gnss(self) -> bool: ...

    @property
    def gnss_table(self) -> str | None: ...

    @property
    def start_s(self) -> int | None: ...

    @property
    def deadline_s(self) -> int | None: ...

    @property
    def samples(self) -> int | None: ...


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
        from fields.geometry.chosen_obstacles import parse_obstacle_place

        for text in obstacles:
            parse_obstacle_place(text)
    if any(not name.strip() for name in ignored):
        raise RequestError(f"{mark_parameter('ignored')} is empty; give the name or number of an obstacle.")


def check_speeds(request: RequestValues) -> None:
    """Raise RequestError for a working speed beyond the limits of the implement."""
    speed_mps, least_mps, greatest_mps = request.speed_mps, request.min_speed_mps, request.max_speed_mps
    if least_mps is not None and speed_mps < least_mps:
        _refuse_speed(speed_mps, "least", "min_speed_mps", least_mps)
    if greatest_mps is not None and speed_mps > greatest_mps:
        _refuse_speed(speed_mps, "greatest", "max_speed_mps", greatest_mps)


def _refuse_speed(speed_mps: float, wording: str, name: str, limit_mps: float) -> None:
    raise RequestError(
        f"The working speed ({mark_parameter('speed_mps')}) is {speed_mps / MPS_PER_KMH:.3g} km/h, and the {wording} "
        f"of the implement ({mark_parameter(name)}) is {limit_mps / MPS_PER_KMH:.3g} km/h; change one of them.",
        parameter="speed_mps",
    )


def check_headland(request: RequestValues) -> None:
    """Raise RequestError for a headland that is left and worked, or given in metres and in passes."""
    if request.no_headland and request.headland_order is not None:
        raise RequestError(
            f"{mark_parameter('no_headland')} leaves the headland, and {mark_parameter('headland_order')} says when to "
            "work it; leave out one of them."
        )
    if request.headland_passes is None:
        return
    for name, meaning in (("no_headland", "leaves the headland"), ("headland_m", "is its depth")):
        if getattr(request, name):
            raise RequestError(
                f"{mark_parameter(name)} {meaning}, and {mark_parameter('headland_passes')} says in how many passes it "
                "is worked; leave out one of them."
            )


def check_bearings(request: RequestValues) -> None:
    """Raise RequestError for bearings beyond a full circle, and for several that exclude each other."""
    for cell, bearing_deg in request.cell_bearings:
        if not abs(bearing_deg) <= FULL_CIRCLE_DEG:
            raise RequestError(
                f"The bearing of cell {cell} ({mark_parameter('cell_bearings')}) is {shorten_value(bearing_deg)}; use "
                f"{-FULL_CIRCLE_DEG:g} to {FULL_CIRCLE_DEG:g} degrees."
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


def check_swaths(request: RequestValues) -> None:
    """Raise RequestError for tracks along contours with a direction of their own, or without worked headlands."""
    if request.swaths == "straight":
        return
    for name in ("bearing_deg", "cell_bearings", "guidance_line", "no_headland"):
        if getattr(request, name) not in (None, (), False):
            raise RequestError(
                f"{mark_parameter('swaths')} {request.swaths} takes its direction from the ground and needs a worked "
                f"headland; leave out {mark_parameter(name)}.",
                parameter="swaths",
            )


def check_times(request: RequestValues) -> None:
    """Raise RequestError for clock times outside of a day, and for a deadline without a start."""
    for name in ("start_s", "deadline_s"):
        time_s = getattr(request, name)
        if time_s is not None and not 0 <= time_s < DAY_S:
            raise RequestError(f"{mark_parameter(name)} is {time_s:g}; give seconds of the day, from 0 to {DAY_S - 1}.")
    if request.deadline_s is None:
        return
    if request.start_s is None:
        raise RequestError(
            f"The deadline {mark_parameter('deadline_s')} needs a start; give {mark_parameter('start_s')} as well.",
            parameter="start_s",
        )
    if request.deadline_s == request.start_s:
        raise RequestError(
            f"The deadline {format_clock(request.deadline_s)} is the start itself; give another "
            f"{mark_parameter('deadline_s')}."
        )


def check_samples(request: RequestValues) -> None:
    """Raise RequestError for no samples where something is judged by them."""
    if request.samples != 0:
        return
    for name in SAMPLED_PARAMETERS:
        if getattr(request, name) is not None:
            raise RequestError(
                f"{mark_parameter('samples')} is 0, and {mark_parameter(name)} is judged by samples; give 1 or more, "
                "or leave out one of them."
            )


def check_ground(request: RequestValues) -> None:
    """Raise RequestError for moisture or rain of no soil, and for rain that is none; a file is read later."""
    for name in ("moisture_pct", "rain_mm"):
        if getattr(request, name) is not None and request.soil is None:
            raise RequestError(f"{mark_parameter(name)} is of a soil; name that with {mark_parameter('soil')} as well.")
    if request.rain_mm is None:
        if request.et0_mm is not None:
            raise RequestError(
                f"{mark_parameter('et0_mm')} is of the days with {mark_parameter('rain_mm')}; give that as well."
            )
        return
    if not is_rain_table(request.rain_mm):
        parse_recent_rain(request.rain_mm)


def check_implement(request: RequestValues) -> None:
    """Raise HeadlandError for an implement or a working depth that the table of drafts does not have."""
    if request.draft is None and request.depth_cm is None:
        return
    from planner.request.implement_choice import find_requested_rule

    find_requested_rule(request)


def check_gnss(request: RequestValues) -> None:
    """Raise RequestError for a table of position errors that is not asked for."""
    if request.gnss_table is not None and not request.gnss:
        raise RequestError(
            f"{mark_parameter('gnss_table')} is used with {mark_parameter('gnss')} alone; set that as well."
        )
