"""Ground that somebody wants to be left out: no plan is to work it, and none is charged for it."""

from __future__ import annotations

import math

import shapely

from fields.geometry.overlays import extract_polygons, subtract_on_grid
from planner.evaluation.context import PlanningContext
from planner.evaluation.site import get_site_moves
from strategies.lines.lay_lines import unite_strips


def find_left_out_ground(context: PlanningContext) -> shapely.Geometry:
    """The ground of lines that were to be left out, as far as no other line covers it."""
    wishes = context.request.line_wishes
    if not wishes.left_out:
        return shapely.Polygon()
    moves = get_site_moves(context)
    out = set(wishes.find_left_out(moves.lines))
    sides = [[line for number, line in enumerate(moves.lines) if (number in out) == is_out] for is_out in (True, False)]
    left, worked = (unite_strips(moves.site, lines) for lines in sides)
    return extract_polygons(subtract_on_grid(left, worked))


def measure_left_out_m2(context: PlanningContext) -> float:
    """The ground that was to be left out; 0 without such a wish."""
    wishes = context.request.line_wishes
    if not wishes.left_out:
        return 0.0
    lines = get_site_moves(context).lines
    return math.fsum(lines[number].own_m2 for number in wishes.find_left_out(lines))
