"""A work order, and what its request names, resolved: field, guidance line, position errors and turning radius."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.arrays import Floats, Integers
from fields.documents.reader import FieldSource, read_field
from fields.geometry.chosen_places import add_obstacles, leave_out_obstacles, set_entrance
from fields.geometry.field import Field
from fields.geometry.field_lines import find_line_bearing_deg
from fields.layout.swaths import Layout
from planner.errors import RequestError, mark_parameter
from planner.evaluation.context import DoneWork
from planner.farm.random_inputs import UncertaintySettings
from planner.farm.settings import FarmTimes, Yard
from planner.farm.workday import FOLD, ROAD, UNFOLD, Workday
from planner.request.plan_request import PlanRequest
from planner.risk.costs import CostTerms
from strategies.rules.supply import Supply
from vehicle.model.gnss import NO_ERROR, load_default_error_table, load_error_table
from vehicle.model.ground import list_ground_names
from vehicle.model.tractor import RADIUS_FACTOR, Implement, Tractor, resolve_tractor

MOST_OFF_M, MOST_OTHER_SHARE = 0.1, 1e-3  # of half of the tracks, and of the ground inside the headland: rounding
_PLAN_TIME = re.compile(r"(?P<file>.+)@(?P<hours>\d{1,3}):(?P<minutes>\d{2})(?::(?P<seconds>\d{2}))?")
FieldChoice = Field | FieldSource | None
"""What replaces the field of a request."""

DoneSource = str | DoneWork


@dataclass(frozen=True, eq=False)
class PlannedLayout:
    """What a plan tells of its layout, in metres from `origin_m`.

    Attributes:
        inside: the ground inside its headland passes; empty without them.
        middles: (n, 2) of what it works on tracks.
    """

    origin_m: tuple[float, float]
    inside: shapely.Geometry
    middles: Floats

    def fits(self, layout: Layout) -> bool:
        """Whether a layout has these tracks inside this headland."""
        shift = np.asarray(self.origin_m) - np.asarray(layout.field.origin_m)
        inside = shapely.transform(self.inside, lambda xy: xy + shift)
        region = layout.inner_region if layout.headland_passes else shapely.Polygon()
        if shapely.symmetric_difference(inside, region).area > MOST_OTHER_SHARE * max(region.area, inside.area):
            return False
        swaths = shapely.MultiLineString([swath.points_m for swath in layout.swaths])
        off_m = shapely.distance(swaths, shapely.points(self.middles + shift))
        return bool(len(off_m)) and float(np.median(off_m)) < MOST_OFF_M


@dataclass(frozen=True)
class WorkOrder:
    """What is to be planned: a request, what replaces its field and machines, and the values of a farm.

    `field` and `tractor` (objects, names or files; for a field also shapes) replace those of the request; `implement`
    gives hitch and length, its width is that of the request.

    `uncertainty` and `cost_terms` are the farm's laws and prices, `supply` is what the implement carries, `times` and
    `yard` make up the day. Without a farm all are None.

    `done` is what is worked already, as it is or by its source (planner.pipeline.going_on). The machines of a saved
    plan among it go on from where they stand, but for those `without` (numbers from 1); with `from_road` they come in
    from outside. Of the layouts that the field could have `layout` is taken, if it is one of them, else the quickest.
    With `simulates_all` plans that cannot win are driven as well.
    """

    request: PlanRequest
    field: FieldChoice = None
    tractor: Tractor | str | Path | None = None
    implement: Implement | None = None
    uncertainty: UncertaintySettings | None = None
    cost_terms: CostTerms | None = None
    supply: Supply | None = None
    times: FarmTimes | None = None
    yard: Yard | None = None
    done: tuple[DoneSource, ...] = ()
    without: tuple[int, ...] = ()
    from_road: bool = False
    layout: PlannedLayout | None = None
    simulates_all: bool = False

    @property
    def begins_on_field(self) -> bool:
        """Whether machines stand on the field: they go on from there, with a saved plan at a time or by themselves."""
        places = (one.stands if isinstance(one, DoneWork) else match_plan_time(one) for one in self.done)
        return not self.from_road and any(places)

    def resolve_tractor(self) -> Tractor:
        """The tractor of the request or the one that replaces it; raises VehicleError for one that is unknown."""
        return resolve_tractor(self.request.tractor if self.tractor is None else self.tractor)

    def name_choices(self) -> PlanRequest:
        """The request with the names of the field and tractor that replace its own."""
        names: dict[str, Any] = {
            parameter: choice.name if isinstance(choice, Field | Tractor) else choice
            for parameter, choice in (("field", self.field), ("tractor", self.tractor))
            if choice is not None
        }
        return replace(self.request, **names) if names else self.request


def match_plan_time(source: DoneSource) -> re.Match[str] | None:
    """The file and the time of a source such as plan.json@13:20; None for any other."""
    return None if isinstance(source, DoneWork) or Path(source).exists() else _PLAN_TIME.fullmatch(source)


def read_requested_field(request: PlanRequest, field: FieldChoice) -> Field:
    """The field of the request or the one that replaces it, with the entrance, obstacles and edges of the request."""
    if not isinstance(field, Field):
        where = request.field if field is None else field
        field = read_field(where, local=request.local, crs=request.crs, swap_axes=request.swap_axes)
    if request.entrance is not None:
        field = set_entrance(field, request.entrance)
    field = add_obstacles(leave_out_obstacles(field, request.ignored), request.obstacles)
    for zone in field.ground_zones:  # a field file may hold those of unknown kinds, but no plan can use them
        if zone.name not in list_ground_names():
            raise RequestError(
                f"The field has a ground zone of {zone.name!r}, which is unknown; use one of: "
                f"{', '.join(list_ground_names())}."
            )
    return field.open_edges() if request.open_edges else field


def resolve_guidance_line(request: PlanRequest, field: Field) -> PlanRequest:
    """The request with the bearing of the guidance line it names."""
    if request.guidance_line is None:
        return request
    bearing_deg = find_line_bearing_deg(field.guidance_lines, request.guidance_line, f"'{field.name}'")
    return replace(request, guidance_line=None, bearing_deg=bearing_deg)


def load_gnss_errors(request: PlanRequest) -> Integers:
    """The table of position errors of a request; raises VehicleError for a file that holds none."""
    if not request.gnss:
        return NO_ERROR
    return load_default_error_table() if request.gnss_table is None else load_error_table(request.gnss_table)


def choose_radius_m(request: PlanRequest, tractor: Tractor, field: Field) -> float:
    ground = field.default_ground
    min_radius_m = tractor.compute_smallest_radius_m(ground)
    if request.radius_m is None:
        return RADIUS_FACTOR * min_radius_m
    if request.radius_m < min_radius_m:
        raise RequestError(
            f"A turning radius ({mark_parameter('radius_m')}) of {request.radius_m:g} m is tighter than {tractor.name} "
            f"can drive on {ground} ({min_radius_m:.2f} m); use {min_radius_m:.2f} m or more."
        )
    west, south, east, north = field.boundary.bounds
    diagonal_m = math.hypot(east - west, north - south)
    if request.radius_m > diagonal_m:
        raise RequestError(
            f"A turning radius ({mark_parameter('radius_m')}) of {request.radius_m:g} m has no room on field "
            f"{field.name!r}, {diagonal_m:.0f} m across; use a smaller one, {min_radius_m:.2f} m or more."
        )
    return request.radius_m


def size_implement(implement: Implement | None, request: PlanRequest) -> Implement:
    """The implement, or a usual one, with the widths of the request."""
    widths = {"width_m": request.width_m, "transport_width_m": request.transport_width_m}
    known = {name: width_m for name, width_m in widths.items() if width_m is not None}
    return (implement or Implement()).model_copy(update=known)


def complete_cost_terms(cost_terms: CostTerms | None, workday: Workday | None, tractor: Tractor) -> CostTerms | None:
    """The prices of a farm with the drive of the tractor, and the travel and handling of its workday."""
    if cost_terms is None:
        return None
    if tractor.battery is not None:
        cost_terms = replace(cost_terms, motor_efficiency=tractor.battery.efficiency)
    if workday is None:
        return cost_terms
    return replace(
        cost_terms,
        road_km=1e-3 * workday.road_ways * workday.road_m,
        road_s=workday.sum_duties_s(ROAD),
        handling_s=workday.sum_duties_s(UNFOLD) + workday.sum_duties_s(FOLD),
    )
