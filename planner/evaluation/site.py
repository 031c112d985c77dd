"""The site of a planning context: its ground, machine and drive, as programmes take them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import shapely

from fields.geometry.arithmetic import EDGE_M
from fields.geometry.field import MIN_FENCE_MARGIN_M
from fields.geometry.overlays import intersect, subtract, unite
from planner.evaluation.context import PlanningContext, StoredMoves
from planner.evaluation.machine_outlines import build_body, folds_at_gate, measure_half_m
from planner.request.implement_choice import keeps_ground
from planner.request.plan_request import STANDING_CROP_OPERATIONS
from strategies.lines.done_lines import begin_where_tractors_stand, find_orders, leave_done_lines
from strategies.lines.lay_lines import lay_headland_lines, lay_lines
from strategies.lines.work_line import WorkLine
from strategies.path_planning.paths import shift_pose_ahead
from strategies.path_planning.turn_kinds import HEADLAND_FIRST, ROUND_CORNERS, SQUARE_CORNERS
from strategies.programmes.site_moves import SiteMoves
from strategies.site.ground import Ground, build_ground
from strategies.site.site import MISSED_FACTOR, ORDER_S, Site
from vehicle.missions.plan import Plan
from vehicle.missions.run import SimulationRun
from vehicle.model.terrain import Terrain
from vehicle.sim.world import World

# Planned paths leave this share of the margin to fences for errors of guidance, and at most so much.
GUIDANCE_MARGIN_SHARE, MAX_GUIDANCE_MARGIN_M = 0.8, 0.3
ROOM_BEYOND_M = 1.0  # distances are known a little beyond what a body reaches
TOLERANCE_M = 0.05  # a drive may reach so far beyond what a plan may
MAX_OUTSIDE_M = 0.5  # of the guided point beyond the outline: a plan that drives farther is refused
LEAST_SEEN_M = 0.6  # half the size of an obstacle that no cell of the grid misses
LANE_SPARE_M = 0.5  # beside a machine that comes in through the entrance
MOST_DRIVE_S = 4e4
CORNER_FACTORS = {SQUARE_CORNERS: math.inf, ROUND_CORNERS: 0.0}  # as asked; else ground is weighed against time
T = TypeVar("T")


def build_site(context: PlanningContext, blocked: shapely.Geometry | None = None) -> Site:
    """The site of a context; edges, obstacles and fences as its request asks, and no body on `blocked` ground."""
    body = build_body(context.tractor, context.implement)
    cap_m = body.reach_m + ROOM_BEYOND_M
    margin_m = max(context.request.margin_m, MIN_FENCE_MARGIN_M)
    spare_m = max(GUIDANCE_MARGIN_SHARE * min(margin_m, MAX_GUIDANCE_MARGIN_M), margin_m - MAX_GUIDANCE_MARGIN_M)
    field, operation = context.layout.field, context.request.operation
    taken = shapely.Polygon() if blocked is None else blocked

    def build_grounds(lane: shapely.Geometry) -> tuple[Ground, Ground]:
        allowed = (_compute_allowed(context, lane, *more_m) for more_m in ((0.0, spare_m), (TOLERANCE_M, EDGE_M)))
        ground, proof_ground = (build_ground(subtract(one, taken), cap_m) for one in allowed)
        return ground, proof_ground

    ground, proof_ground = build_grounds(shapely.Polygon())
    crop_stands, rule = operation in STANDING_CROP_OPERATIONS, context.request.find_draft_rule()
    implement = context.implement
    tracks = intersect(context.layout.inner_region, field.boundary)
    standing = None
    if crop_stands and HEADLAND_FIRST in context.request.headland_orders:  # known as deep as the headland
        outline = shapely.Polygon(field.whole_boundary.exterior)
        standing = build_ground(outline, context.layout.headland_m + ROOM_BEYOND_M)
    return Site(
        layout=context.layout,
        headland_passes=context.headland_passes,
        rules=context.driving_rules,
        body=body,
        folded=build_body(context.tractor, implement.folded) if implement.folds else None,
        fold_s=implement.fold_s,
        ground=ground,
        proof_ground=proof_ground,
        gate_grounds=None if context.gateway is None else build_grounds(build_lane_ground(context)),
        crop_stands=crop_stands,
        keeps_ground=keeps_ground(operation, rule),
        furrow_s=ORDER_S if rule is not None and rule.in_furrows else 0.0,
        kept=build_ground(tracks, ROOM_BEYOND_M),
        standing=standing,
        axle_m=context.tractor.rear_axle_m,
        turn_kinds=context.turn_kinds,
        lane=context.gateway,
        folds_at_gate=folds_at_gate(context.tractor, context.implement),
        drive=partial(_drive_alone, context, context.physics.terrain),
        drive_level=partial(_drive_alone, context, None),
        is_alike=context.physics.terrain is None and not field.ground_zones,
        corner_factor=CORNER_FACTORS.get(context.request.corners, MISSED_FACTOR),
    )


def get_site_moves(context: PlanningContext, headland_lines: dict[int, list[WorkLine]] | None = None) -> SiteMoves:
    """The work lines of a context and what is known of the moves between them, shared by its candidates.

    `headland_lines`, by the number of headland passes, are shared by the layouts of a field.
    """

    def build() -> SiteMoves:
        moves = build_site_moves(context, build_site(context), headland_lines)
        if context.move_cache is not None:
            context.move_cache.load(context, moves)
        return moves

    return recall(context, SiteMoves, build)


def store_moves(context: PlanningContext) -> None:
    """Store what is known of the moves of a context in its cache."""
    if context.move_cache is not None and SiteMoves in context.site_cache:
        context.move_cache.store(context)


def build_site_moves(
    context: PlanningContext, site: Site, headland_lines: dict[int, list[WorkLine]] | None = None
) -> SiteMoves:
    """As `get_site_moves`, on a site of the context; without what is done, and from where tractors stand."""
    laid = {} if headland_lines is None else headland_lines
    passes, going_on = context.layout.headland_passes, context.going_on
    whole = replace(site, layout=replace(site.layout, field=replace(site.layout.field, done=None)))
    if passes not in laid:
        laid[passes] = lay_headland_lines(whole)
    lines = lay_lines(whole, laid[passes])
    if going_on is None:
        return SiteMoves(site, lines)
    lines = leave_done_lines(site, lines, going_on.error_m)
    stands = [(stand.pose, stand.is_folded) for stand in going_on.stands]
    lines, starts = begin_where_tractors_stand(site, lines, stands, going_on.error_m)
    folded = frozenset(node for node, (_, is_folded) in zip(starts, stands, strict=True) if is_folded)
    orders = find_orders(site, lines, starts, [stand.ahead for stand in going_on.stands])
    return SiteMoves(site, lines, starts, tuple(stand.used for stand in going_on.stands), orders, folded)


def tell_moves(context: PlanningContext) -> tuple[Any, ...] | None:
    """What another process takes to know the same of moves, without laying, asking or loading; None before that."""
    moves: SiteMoves | None = context.site_cache.get(SiteMoves)
    if moves is None:
        return None
    laid = moves.lines, moves.starts, moves.used, moves.orders, moves.folded
    return *laid, moves.tables, context.site_cache.get(StoredMoves)


def take_moves(context: PlanningContext, state: tuple[Any, ...]) -> None:
    """Let a context have the lines, and what is known of the moves between them, that `tell_moves` gave of it."""
    *laid, tables, stored = state
    moves = context.site_cache[SiteMoves] = SiteMoves(build_site(context), *laid)
    if stored is not None:
        context.site_cache[StoredMoves] = stored
    for name, table in moves.tables.items():
        table.update(tables[name])


def recall(context: PlanningContext, kind: type, find: Callable[[], T]) -> T:
    """What the candidates of a context share of a kind, found when the first of them asks."""
    if kind not in context.site_cache:
        context.site_cache[kind] = find()
    found: T = context.site_cache[kind]
    return found


def _compute_allowed(
    context: PlanningContext, lane: shapely.Geometry, tolerance_m: float, fence_m: float
) -> shapely.Geometry:
    """What bodies may touch: up to the overhang beyond edges and on a lane, but `fence_m` off fences, and off obstacles
    as asked.

    From obstacles a drive keeps the whole margin, measured to the tolerance of proofs.

    However large that overhang, the guided point stays on the field: the ground ends where it would leave by too much.
    """
    field = context.layout.field
    gate = shapely.Polygon()
    if context.gateway is not None:
        gate = shapely.Point(context.gateway.in_pose[:2]).buffer(context.gate_half_width_m)
    fences = subtract(unite(field.fences), gate)
    outline = field.whole_boundary
    body = build_body(context.tractor, context.implement)
    rear_m, front_m, half_m = body.boxes[0]  # of the tractor, whose nearest side is outside before the guided point is
    beside_m = max(0.0, min(half_m, front_m - body.guide_m, body.guide_m - rear_m))
    overhang_m = min(context.request.overhang_m, MAX_OUTSIDE_M - TOLERANCE_M + beside_m)
    near = shapely.Polygon(outline.exterior).buffer(overhang_m, join_style="mitre")
    edges = intersect(field.compute_overhang_region(overhang_m), near)
    outside = unite([edges, lane]).buffer(tolerance_m, join_style="mitre")
    obstacle_m = context.request.margin_m + tolerance_m
    blocked = []
    for one in field.solid_obstacles:
        west, south, east, north = one.bounds
        inside_m = 0.5 * float(min(east - west, north - south))
        blocked.append(one.buffer(max(obstacle_m, LEAST_SEEN_M - inside_m)))
    return subtract(outside, unite([*blocked, fences.buffer(fence_m)]))


def build_lane_ground(context: PlanningContext) -> shapely.Geometry:
    """The strip through the entrance on which a machine comes in from outside; empty without an entrance."""
    lane = context.gateway
    if lane is None:
        return shapely.Polygon()
    tractor, implement = context.tractor, context.at_gate.implement
    reach_m = build_body(tractor, implement).guided_reach_m
    ends = [shift_pose_ahead(lane.in_pose, distance_m)[:2] for distance_m in (-reach_m, lane.lead_m)]
    return shapely.buffer(shapely.LineString(ends), measure_half_m(tractor, implement) + LANE_SPARE_M, cap_style="flat")


def _drive_alone(context: PlanningContext, terrain: Terrain | None, plan: Plan) -> SimulationRun:
    """Drive a plan on a terrain, each tractor as if it were alone, without errors of position, while there is time."""
    context.time_share.check()
    load = context.physics.driven_load
    world = World(plan, context.tractor, context.implement, terrain=terrain, load=load)
    return world.run(max_time_s=MOST_DRIVE_S, independent=True)
