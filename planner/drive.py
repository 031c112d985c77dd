"""The best plan once more, with everything a picture needs."""

from __future__ import annotations

import numpy as np

from planner.evaluate import Candidate, run_candidate
from planner.measure import guided_point
from planner.site import Site
from reports.results import Drive, Ranking
from vehicle.run import Run


def best_drive(site: Site, ranking: Ranking) -> tuple[Run | None, Drive | None]:
    """Run and picture data of the best plan; (None, None) when there is none."""
    best = ranking.best
    if best is None:
        return None, None
    run = run_candidate(site, Candidate(best.strategy, best.tractors)).run
    plural = "s" if best.tractors > 1 else ""
    return run, picture(site, run, f"{best.strategy}, {best.tractors} tractor{plural}, turns: {best.turn}")


def picture(site: Site, run: Run, title: str) -> Drive:
    """Plain arrays of a run on its field."""
    boundary, layout = site.layout.field.boundary, site.layout
    step = float(run.time_s[1] - run.time_s[0])
    shares = run.time_shares()
    return Drive(
        title=title,
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
