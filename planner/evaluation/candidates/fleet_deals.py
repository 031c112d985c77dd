"""How lines are dealt to a fleet beside what its strategy says: tidier, by who stands near, so that fewer wait."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fields.arrays import Flags
from strategies.lines.deal_apart import (
    SketchTours,
    deal_runs,
    deal_sides,
    deal_tours,
    find_near_blocks,
    find_swath_middles,
    list_deals_apart,
)
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from strategies.programmes.programme import Sketch
from strategies.programmes.site_moves import SiteMoves
from strategies.rules.dealing import LineDeal, group_swath_lines
from strategies.split_field import deal_blocks
from vehicle.missions.plan import HEADLAND_PASS

TIDY_SHARE = 0.05  # of the cost of tours: what people give for tractors that each keep to their part of the headland
SketchDeal = Callable[[Flags], Sketch]
"""Sketches tours by a deal of lines."""


def sketch_tidily(sketch: SketchDeal, moves: SiteMoves, deal: LineDeal) -> tuple[Sketch, Flags]:
    """A sketch by a deal in a way that people would rather see, with the lines for each.

    Every side of the headland is one tractor's in all passes, and the tracks of each are neighbours. What is clearly
    dearer than by the deal alone is not taken.
    """
    lines, free = moves.lines, sketch(deal.allowed)
    most_s = (1.0 + TIDY_SHARE) * free.cost_s
    found, allowed = _sketch_tidier(sketch, deal_sides(lines, deal.allowed), (free, deal.allowed), most_s)
    return _sketch_tidier(sketch, deal_runs(lines, allowed, found.tours), (found, allowed), most_s)


def _sketch_tidier(
    sketch: SketchDeal, tidier: Flags, known: tuple[Sketch, Flags], most_s: float
) -> tuple[Sketch, Flags]:
    """The sketch by a tidier deal, with that; what is `known` where it costs more than `most_s`, or is the same."""
    if np.array_equal(tidier, known[1]):
        return known
    tidy = sketch(tidier)
    return (tidy, tidier) if tidy.cost_s <= most_s else known


def list_other_deals(
    sketch: SketchDeal, moves: SiteMoves, deal: LineDeal, order: str, *, goes_on: bool
) -> list[LineDeal]:
    """What is tried where a deal makes the tractors of a fleet wait.

    Where a crop stands the first is that by which all are done with the headland together: nobody waits for its end.
    """
    if len(deal.allowed) == 1:
        return []

    def sketch_tours(allowed: Flags) -> list[list[int]]:
        return sketch(allowed).tours

    if goes_on:
        return _list_deals_from_here(moves, len(deal.allowed), sketch_tours)
    others = list_deals_apart(moves.lines, deal.allowed, sketch_tours)
    if moves.site.crop_stands and order == HEADLAND_FIRST:
        is_headland = [line.task.kind == HEADLAND_PASS for line in moves.lines]
        others.insert(0, deal_tours(deal.allowed, sketch_tours(deal.allowed & is_headland)))
    return [replace(deal, allowed=allowed) for allowed in others]


def _list_deals_from_here(moves: SiteMoves, tractors: int, sketch_tours: SketchTours) -> list[LineDeal]:
    """Deals of what is left: as it was dealt before, in that order and in any, then each part the tractor's that
    stands near.

    What was nobody's before comes last in that order.
    """
    free = np.ones((tractors, len(moves.lines)), bool)
    before, places = free.copy(), np.full(len(moves.lines), len(moves.lines))
    for tractor, order in enumerate(moves.orders):
        lines = [node // 2 for node in order]
        before[:, lines], before[tractor, lines] = False, True
        places[lines] = range(len(lines))
    ends = np.array(moves.ends)[:, :2]
    entrance = ends[:-1].mean(axis=0) if moves.site.lane is None else ends[-1]  # without one it may begin anywhere
    stands = np.array([*ends[list(moves.starts)], *[entrance] * (tractors - len(moves.starts))])
    if len(group_swath_lines(moves.lines)) < tractors:
        deals = list_deals_apart(moves.lines, free, sketch_tours, stands)
    else:
        blocks = deal_blocks(moves.lines, moves.site.rules, tractors).allowed
        near = find_near_blocks(find_swath_middles(moves.lines, blocks), stands)
        deals = [deal[near] for deal in (blocks, *list_deals_apart(moves.lines, blocks, sketch_tours))]
    return [LineDeal(before, places=places.tolist()), *map(LineDeal, (before, *deals))]
