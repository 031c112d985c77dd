"""A small map of one plan for pages with many of them: thousandths of the larger side, y down, as SVG path data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from reports.common.palette import TRACTOR_COLOURS
from reports.common.plan_drives import PlanDrive, Points
from reports.plan.drive_geometry import (
    WORKING,
    Viewport,
    build_swath_outline,
    choose_round_length_m,
    compute_extent,
    split_by_status,
)

SIDE, MARGIN, FOOT = 1000.0, 25.0, 70.0
"""Of the larger side of the field, of the margin around it, and of the room below for the scale bar."""
PATH_TOLERANCE_SHARE = 0.002  # of the larger side
SmallMap = dict[str, Any]
"""Plain values that can be kept as JSON; `reports/small_map.html.j2` draws them."""


def build_small_map(drive: PlanDrive, driven_over: Sequence[Points] = ()) -> SmallMap:
    """The field with headland passes, the path of every tractor, missed ground, and rings of ground `driven_over`."""
    box = compute_extent(drive)
    size_m = box.size or 1.0
    scale = SIDE / size_m
    view = Viewport(box.west, box.north, scale, MARGIN)
    bar_m = choose_round_length_m(max(box.width, 0.5 * size_m) / 3)
    lanes = []
    for number, (xy, status) in enumerate(zip(drive.xy, drive.status, strict=True)):
        lines = {"work": "", "turn": ""}
        for piece in split_by_status(xy, status, PATH_TOLERANCE_SHARE * size_m):
            lines["work" if piece.status == WORKING else "turn"] += view.format_path(piece.points)
        lanes.append({"colour": number % len(TRACTOR_COLOURS), **lines})
    return {
        "width": round(box.width * scale + 2 * MARGIN),
        "height": round(box.height * scale + 2 * MARGIN + FOOT),
        "field": view.format_rings([drive.boundary, *drive.holes]),
        "obstacles": view.format_rings(drive.obstacles),
        "swaths": view.format_rings(build_swath_outline(swath, drive.width_m) for swath in drive.swaths),
        "headland_passes": [
            {"line": view.format_path(one.points), "tint": one.number % 2} for one in drive.headland_passes
        ],
        "pass_width": round(drive.width_m * scale),
        "missed": view.format_rings(drive.unworked),
        "driven_over": view.format_rings(driven_over),
        "lanes": lanes,
        "bar": round(bar_m * scale),
        "bar_text": f"{bar_m:g} m",
    }
