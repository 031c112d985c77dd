"""Join the polylines of a plan's legs to the paths that guidance follows."""

from __future__ import annotations

import math

from vehicle.jit import compiled

SAME_M = 1e-6


@compiled
def join_legs(points, sizes, begins, new_run, path, along, ends, first, last) -> int:  # type: ignore[no-untyped-def]
    """Write the joined paths of all missions; returns how many points they have.

    `points` (p, 2) are those of all legs in order, `sizes` (legs,) their numbers; `begins` and `new_run` (legs,) tell
    with which legs a mission begins, and a run of legs of one gear, within which the lookahead may pass leg ends. A
    point of a leg that coincides with the one before it is left out. Within a run a leg continues from where the one
    before ended, so that the distance along the path is that of the joined polyline.

    Written are `path` (p, 2) and `along` (p,), the distance from the start of the mission, and per leg in `ends` the
    distance at its end, in `first` its first segment, and in `last` the last one of its run.
    """
    size, place, run_start = 0, 0, 0
    done = 0.0
    for leg in range(len(sizes)):
        if begins[leg]:
            done = 0.0
        start, kept = size, 0
        if new_run[leg]:
            run_start = leg
            x, y = points[place]
            path[size, 0], path[size, 1], along[size] = x, y, done
            size, kept = size + 1, 1
        else:
            start = size - 1
            x, y = path[start]
        driven = 0.0
        for place_in in range(place + 1, place + sizes[leg]):
            next_x, next_y = points[place_in]
            step = math.hypot(next_x - x, next_y - y)
            driven += step
            if step > SAME_M:
                path[size, 0], path[size, 1], along[size] = next_x, next_y, done + driven
                size, kept = size + 1, kept + 1
            x, y = next_x, next_y
        if kept == 0:
            path[size], along[size] = path[start], done
            size += 1
        place += sizes[leg]
        done += driven
        ends[leg], first[leg] = done, start
        last[run_start : leg + 1] = size - 2
    return size
