"""What a picture of a run needs, as plain arrays."""

from __future__ import annotations

import numpy as np

from planner.measure import guided_point
from planner.site import Site
from reports.results import Drive, PlanResult
from vehicle.run import Run


def picture(site: Site, run: Run, result: PlanResult) -> Drive:
    """Plain arrays of the run of a plan on its field."""
    plural = "s" if result.tractors > 1 else ""
    boundary, layout = site.layout.field.boundary, site.layout
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
    )
