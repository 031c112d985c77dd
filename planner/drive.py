"""What a picture of a run needs, as plain arrays."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from planner.measure import coverage, guided_point
from planner.site import Site
from reports.results import Drive, PlanResult, Points
from vehicle.run import Run

MISSED_TO_M = 0.1  # of what is left open, a picture needs no more


def picture(site: Site, run: Run, result: PlanResult) -> Drive:
    """Plain arrays of the run of a plan on its field."""
    plural = "s" if result.tractors > 1 else ""
    boundary, layout = site.layout.field.ground, site.layout
    step = float(run.time_s[1] - run.time_s[0])
    shares = run.time_shares()
    return Drive(
        title=f"{result.strategy}, {result.tractors} tractor{plural}, turns: {result.turn}",
        boundary=np.asarray(boundary.exterior.coords)[:, :2],
        holes=tuple(np.asarray(hole.coords)[:, :2] for hole in boundary.interiors),
        tracks=np.array([[track.start, track.end] for track in layout.tracks]),
        width_m=layout.width_m,
        step_s=step,
        xy=tuple(guided_point(run, site, tractor) for tractor in range(run.plan.tractors)),
        status=tuple(run.status(tractor) for tractor in range(run.plan.tractors)),
        finish_s=tuple(float(t) for t in run.finish_s),
        seconds={name: tuple(float(v) for v in values) for name, values in shares.items()},
        entrance=layout.field.entrance,
        missed=_rings(coverage(run, site).missed),
        largest_missed=result.largest_missed,
    )


def _rings(pieces: tuple[shapely.Polygon, ...]) -> tuple[Points, ...]:
    """Outlines and holes of pieces of ground, plain enough to be drawn."""
    plain = (orient(piece.simplify(MISSED_TO_M), 1.0) for piece in pieces)
    return tuple(np.asarray(ring.coords)[:-1, :2] for one in plain for ring in (one.exterior, *one.interiors))
