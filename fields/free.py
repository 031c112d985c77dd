"""Where the guided point of a tractor may be: the field drawn in, and what of that lies beside the tracks."""

from __future__ import annotations

import shapely

from fields.field import Field
from fields.layout import Layout

GRID_M = 1e-6  # without a grid GEOS leaves slivers where swaths meet edge to edge
MITRE_LIMIT = 2.0
SWATH = 0.55  # of the width to either side of a track: neighbouring swaths overlap, so that no gap is left between


def free_space(field: Field, margin_m: float) -> shapely.Geometry:
    """The field drawn in by a margin, obstacles widened by it; may be empty or in several parts."""
    open_ground = shapely.difference(field.boundary, shapely.union_all(field.small)) if field.small else field.boundary
    return open_ground.buffer(-margin_m, join_style="mitre", mitre_limit=MITRE_LIMIT)


def rim_of(field: Field, margin_m: float, rim_m: float) -> shapely.Geometry:
    """The field drawn in by no more than `rim_m`, but as far from obstacles as `free_space` is."""
    rings = [shapely.Polygon(hole) for hole in field.boundary.interiors]
    taken = [ring.buffer(margin_m, join_style="mitre", mitre_limit=MITRE_LIMIT) for ring in (*rings, *field.small)]
    outline = shapely.Polygon(field.boundary.exterior).buffer(-rim_m, join_style="mitre")
    return shapely.difference(outline, shapely.union_all(taken))


def beside_tracks(layout: Layout, free: shapely.Geometry) -> shapely.Geometry:
    """The free space without the swaths: where turning tramples nothing that is worked in tracks."""
    swaths = shapely.linestrings([[track.start, track.end] for track in layout.tracks])
    worked = shapely.buffer(swaths, SWATH * layout.width_m, cap_style="flat")
    rest = shapely.difference(free, shapely.union_all(worked, grid_size=GRID_M), grid_size=GRID_M)
    return shapely.buffer(rest, GRID_M)
