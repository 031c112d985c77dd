"""Ground that runs worked in a field: worked once, again, and missed.

The tool's middle follows the logged path, `behind_m` behind it, and sweeps the working width. Paths are cut into pieces
of some 40 m, so that ground that one long stretch comes over again counts as worked again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import shapely

from planner.ground.overlays import left_of, only_areas, united, within
from planner.works.metres import STANDING_MPS
from planner.works.phases import stretches
from planner.works.record import Array, Driven
from reports.work_results import Ground, Points

PIECE_M, SMOOTH_M = 40.0, 0.1
SLIVER_M = 0.4  # positions of logs are no better: narrower pieces say nothing of a place
MOST_PIECES = 200


def ground(runs: Sequence[Driven], field: shapely.Polygon, width_m: float, behind_m: float) -> Ground:
    """What of a field the runs worked with a tool of `width_m`, in metres of their system."""
    strips = [
        within(field, strip) for run in runs for line in tool_lines(run, behind_m) for strip in _strips(line, width_m)
    ]
    worked = united(np.array(strips, dtype=np.object_)) if strips else shapely.MultiPolygon()
    missed = left_of(field, worked)
    total = float(sum(strip.area for strip in strips))
    return Ground(
        float(worked.area), max(0.0, total - float(worked.area)), float(missed.area), _rings(_wide(missed)),
        _rings(_wide(_again(strips))),
    )  # fmt: skip


def tool_lines(run: Driven, behind_m: float) -> Iterator[Array]:
    """Paths (n, 2) of the tool's middle for every stretch of work; a standing machine has no course and adds none."""
    angle = np.radians(run.heading_deg)
    tool = run.xy - behind_m * np.column_stack([np.sin(angle), np.cos(angle)])
    for first, last in stretches(run.works):
        rows = np.arange(first, min(last + 1, len(tool)))
        line = tool[rows[run.speed_mps[rows] >= STANDING_MPS]]
        if len(line) > 1 and float(np.hypot(*np.diff(line, axis=0).T).sum()) > SMOOTH_M:
            yield line


def _strips(line: Array, width_m: float) -> Iterator[shapely.Geometry]:
    """The ground under the tool along a path, piece by piece."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    cuts = np.searchsorted(length, np.arange(PIECE_M, length[-1] - 0.5 * PIECE_M, PIECE_M))
    for first, last in zip([0, *cuts.tolist()], [*cuts.tolist(), len(line) - 1], strict=True):
        if last > first:
            piece = shapely.LineString(line[first : last + 1]).simplify(SMOOTH_M)
            if piece.length > 0.0:
                yield piece.buffer(0.5 * width_m, cap_style="flat", join_style="mitre", mitre_limit=2.0)


def _again(strips: Sequence[shapely.Geometry]) -> shapely.Geometry:
    """Ground in two strips or more, what neighbouring pieces of one path share left out by its narrowness."""
    tree = shapely.STRtree(strips)
    one, other = tree.query(strips, predicate="intersects")
    pairs = one < other
    shapes = np.array(strips, dtype=np.object_)
    shared = [only_areas(each) for each in shapely.intersection(shapes[one[pairs]], shapes[other[pairs]])]
    return united(np.array(shared, dtype=np.object_)) if shared else shapely.MultiPolygon()


def _wide(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """Pieces without what is narrower than SLIVER_M, the largest first."""
    core = only_areas(shape).buffer(-0.5 * SLIVER_M, join_style="mitre").buffer(0.5 * SLIVER_M, join_style="mitre")
    parts = [one for one in shapely.get_parts(core) if one.geom_type == "Polygon" and one.area > SLIVER_M**2]
    return sorted(parts, key=lambda one: (-one.area, one.bounds))[:MOST_PIECES]


def _rings(pieces: Sequence[shapely.Polygon]) -> tuple[Points, ...]:
    """The outer rings of pieces, and the inner ones of each behind it, turned the other way."""
    found = []
    for piece in pieces:
        whole = shapely.orient_polygons(piece) if hasattr(shapely, "orient_polygons") else shapely.normalize(piece)
        found += [np.array(ring.coords)[:, :2] for ring in (whole.exterior, *whole.interiors)]
    return tuple(found)
