"""What of a field no track and no round covers as they are laid, and why: known before anything is driven."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely

from fields.field import LEAST_FENCE_MARGIN_M
from planner.ground.overlays import GRID_M, only_areas
from planner.site import Site
from strategies.headland.corners import missed_m2, tangent_m
from strategies.ways.around import clear_parts

LEAST_M2 = 1.0  # less ground open for one reason is not told
SLIVER_M = 0.1  # open ground narrower than this is rounding of outlines
EDGE_M = 0.05  # ground so near the outline lies on it
BESIDE = 2.0  # widths round a small obstacle in which swaths bend
MITRE_LIMIT, SHARP_LIMIT = 2.0, 20.0


@dataclass(frozen=True, eq=False)
class Unworked:
    """Ground that stays open for one reason: in words, area (m2) and its pieces, the largest first."""

    why: str
    m2: float
    pieces: tuple[shapely.Polygon, ...]


def unworked(site: Site) -> tuple[Unworked, ...]:
    """The ground that stays open, by reason. What guidance misses is not known before a plan is driven."""
    boundary = site.layout.field.ground
    kept = [] if site.layout.field.outline is None else list(_around_obstacles(site, site.layout.field.outline))
    rest = only_areas(shapely.difference(boundary, laid(site), grid_size=GRID_M))
    cut = _cut_off(site)
    kept.append((f"cut off: no way there is as wide as the machines ({_wide_m(site):g} m)", cut))
    rest = only_areas(shapely.difference(rest, cut, grid_size=GRID_M))
    for why, zone in _zones(site):
        part = only_areas(shapely.intersection(rest, zone, grid_size=GRID_M))
        kept.append((why, part))
        rest = only_areas(shapely.difference(rest, part, grid_size=GRID_M))
    kept += _others(site, rest)
    told = [Unworked(why, float(part.area), _pieces(part)) for why, part in kept]
    told.append(Unworked("estimate: tips of corners that are driven round", _round_corners_m2(site), ()))
    return tuple(one for one in told if one.m2 >= LEAST_M2)


def laid(site: Site) -> shapely.Geometry:
    """The ground under the tracks and rounds of a site."""
    half = 0.5 * site.layout.width_m
    swaths = [
        line.buffer(half, cap_style="flat", join_style="mitre", mitre_limit=SHARP_LIMIT)
        for line in (*_tracks(site), *_rounds(site))
    ]
    return only_areas(shapely.union_all(swaths, grid_size=GRID_M))


def _tracks(site: Site) -> Iterator[shapely.LineString]:
    """Centre lines of the tracks, bent where small obstacles are driven round."""
    for track in site.layout.tracks:
        bent = site.around.bent.get(track.start)
        yield shapely.LineString([track.start, track.end] if bent is None else bent.between(0.0, track.length))


def _rounds(site: Site) -> Iterator[shapely.LineString]:
    for one in site.rounds:
        points = np.asarray(one.line.coords)
        parts = None if site.around.bender is None else clear_parts(points, site.around.bender)
        yield from [one.line] if parts is None else [shapely.LineString(part) for part, _ in parts]


def _wide_m(site: Site) -> float:
    return max(site.implement.width_m, site.tractor.width_m)


def _around_obstacles(site: Site, drawn: shapely.Polygon) -> Iterator[tuple[str, shapely.Geometry]]:
    """What the margin takes of the field as it was drawn, and what lies behind obstacles."""
    field = site.layout.field
    margin_m = max(site.scenario.margin_m, LEAST_FENCE_MARGIN_M if field.fences else 0.0)
    bare = shapely.union_all([one.shape for one in field.obstacles], grid_size=GRID_M)
    lost = shapely.difference(shapely.difference(drawn, bare, grid_size=GRID_M), field.ground, grid_size=GRID_M)
    solid = shapely.union_all([bare, *map(shapely.Polygon, drawn.interiors), *field.fences], grid_size=GRID_M)
    near = solid.buffer(2.0 * margin_m + EDGE_M)
    what = "obstacles and fences" if field.fences else "obstacles"
    yield f"cut off by {what}", only_areas(shapely.difference(lost, near, grid_size=GRID_M))
    yield f"margin of {margin_m:g} m to {what}", only_areas(shapely.intersection(lost, near, grid_size=GRID_M))


def _cut_off(site: Site) -> shapely.Geometry:
    """Ground that the machines are not too wide for, but for the way there."""
    parts = sorted(shapely.get_parts(site.free), key=lambda part: (-part.area, part.bounds))
    back = [part.buffer(0.5 * _wide_m(site), join_style="mitre", mitre_limit=MITRE_LIMIT) for part in parts[1:]]
    away = shapely.intersection(shapely.union_all(back, grid_size=GRID_M), site.layout.field.ground)
    return only_areas(away)


def _zones(site: Site) -> Iterator[tuple[str, shapely.Geometry]]:
    """Reasons and where they hold, the strongest first."""
    layout, boundary = site.layout, site.layout.field.ground
    half = 0.5 * layout.width_m
    if layout.field.beyond is not None:
        band = shapely.difference(layout.field.beyond, layout.field.boundary, grid_size=GRID_M)
        what = "obstacles and fences" if layout.field.fences else "obstacles"
        yield f"beside {what}: beyond the margin, room for what machines swing out in turns", only_areas(band)
    wide = boundary.buffer(-half + EDGE_M, join_style="mitre", mitre_limit=MITRE_LIMIT)
    wide = wide.buffer(half - EDGE_M, join_style="mitre", mitre_limit=SHARP_LIMIT)
    yield f"narrower than the implement ({layout.width_m:g} m)", only_areas(shapely.difference(boundary, wide))
    small = shapely.union_all(layout.field.small).buffer(BESIDE * layout.width_m)
    yield "beside obstacles that are driven round", small
    if not layout.rounds:
        lines = shapely.linestrings([[track.start, track.end] for track in layout.tracks])
        near = shapely.union_all(shapely.buffer(lines, layout.headland_m + layout.width_m), grid_size=GRID_M)
        yield "headland, left as room for turning", near
        yield "no track has room there between its headlands", boundary


def _others(site: Site, rest: shapely.Geometry) -> Iterator[tuple[str, shapely.Geometry]]:
    """What is left without another reason: at the outline or inside."""
    core = rest.buffer(-0.5 * SLIVER_M, join_style="mitre").buffer(0.5 * SLIVER_M, join_style="mitre")
    parts = shapely.get_parts(only_areas(core))
    outline = site.layout.field.ground.boundary
    touches = shapely.dwithin(parts, outline, EDGE_M)
    yield "tips and bays of the outline that no round reaches into", shapely.multipolygons(parts[touches])
    yield "between rounds and tracks", shapely.multipolygons(parts[~touches])


def _pieces(ground: shapely.Geometry) -> tuple[shapely.Polygon, ...]:
    parts = [part for part in shapely.get_parts(ground) if part.area > 0.0]
    return tuple(sorted(parts, key=lambda part: (-round(part.area, 3), part.bounds)))


def _round_corners_m2(site: Site) -> float:
    """What rounds with round corners miss of their own bands; a corner without room for its arc is not driven round."""
    if site.scenario.corners != "round":
        return 0.0
    radius_m = site.manner.radius_m
    return sum(
        missed_m2(side.after_rad, site.layout.width_m, radius_m)
        for one in site.rounds
        for side, after in zip(one.sides, (*one.sides[1:], one.sides[0]), strict=True)
        if side.after_rad > 0.0 and 2.0 * tangent_m(side.after_rad, radius_m) <= min(side.length_m, after.length_m)
    )
