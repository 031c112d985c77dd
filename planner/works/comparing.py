"""A saved plan and the runs that were driven of it: time by kind, ground, and where the difference comes from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from fields.projection import project
from fields.read import read_field
from fields.reading import some
from planner.errors import HeadlandError, ScenarioError
from planner.showing import Shown, machines_with, show
from planner.works.example import antenna
from planner.works.files import read_runs
from planner.works.ground import ground, tool_lines
from planner.works.metres import course_deg, speeds
from planner.works.phases import stretches
from planner.works.record import Array, Driven
from planner.works.summary import summary
from reports.work_results import (
    STANDING,
    TURNING,
    UNLOGGED,
    WAY,
    WORKING,
    Comparison,
    Difference,
    Figures,
    Ground,
    Points,
    Side,
)
from vehicle.layout import WORKING as AT_WORK
from vehicle.missions import LEAVE

NEAR_M, MOST = 20.0, 0.5
"""A run is of the field where more than this share of its places lies in it or so near to it."""
EVERY = 10  # rows of the 10 Hz record: plans are compared at the pace of logs
PLAN = "plan"


def compare(plan: str | Path, paths: Sequence[str | Path]) -> Comparison:
    """A plan of `headland plan --save` and imported runs of its field.

    Raises MissionError, ScenarioError, VehicleError, LogError: the plan is none, or no run lies in its field.
    """
    shown = show(plan)
    runs = read_runs(paths)
    crs = shown.saved.crs
    if crs is None:
        raise ScenarioError(
            "The plan is in local metres and runs have a place on the earth; plan the field in longitude and latitude."
        )
    placed = [_in_system(run, crs) for run in runs]
    planned = [planned_run(shown, tractor) for tractor in range(shown.saved.plan.tractors)]
    field, said = _field(shown, placed, planned)
    own = [run for run in placed if _share_inside(run, field) > MOST]
    if not own:
        raise ScenarioError(
            f"None of the {some(len(runs), 'run')} lies in the field {shown.scenario.field!r} of the plan; give those "
            "that do."
        )
    tractor, implement = machines_with(shown.saved, shown.scenario)
    behind = tractor.antenna_forward_m + implement.hitch_m
    sides = [_side(each, field, shown.scenario.width_m, behind, said) for each in (planned, own)]
    return Comparison(
        name=_name(own, shown),
        field_m2=float(field.area) if said else None,
        boundary=tuple(np.array(ring.coords)[:, :2] for ring in (field.exterior, *field.interiors)) if said else (),
        width_m=shown.scenario.width_m,
        planned=sides[0],
        driven=sides[1],
        differences=tuple(_differences(sides[0].figures, sides[1].figures)),
        notes=tuple(_notes(runs, own, shown, None if sides[1].ground is None else behind, said)),
    )


def planned_run(shown: Shown, tractor: int) -> Driven:
    """What a tractor of a plan does, once a second, as its antenna would log it."""
    run = shown.run
    end = int(np.searchsorted(run.time_s, run.finish_s[tractor]))
    rows = np.unique(np.append(np.arange(0, min(end + 1, len(run.time_s)), EVERY), min(end, len(run.time_s) - 1)))
    xy = antenna(shown, tractor)[rows] + np.array(shown.saved.origin_m)
    legs = run.plan.missions[tractor].legs
    down = np.array([leg.implement and leg.task.kind != LEAVE for leg in legs])
    works = down[np.minimum(run.leg(tractor)[rows], len(legs) - 1)] & (run.status(tractor)[rows] == AT_WORK)
    time_s = run.time_s[rows]
    return Driven(
        f"tractor {tractor + 1}", PLAN, shown.saved.crs or "", time_s, xy, course_deg(xy), speeds(time_s, xy), works,
        width_m=shown.scenario.width_m, field=shown.scenario.field,
    )  # fmt: skip


def _in_system(run: Driven, crs: str) -> Driven:
    """A run in another system of metres."""
    if run.crs == crs:
        return run
    xy = project(run.xy, run.crs, crs)
    outline = run.outline
    if outline is not None:
        outline = shapely.transform(outline, lambda points: project(points, run.crs, crs))
    return replace(run, crs=crs, xy=xy, heading_deg=course_deg(xy), outline=outline)


def _field(shown: Shown, runs: Sequence[Driven], planned: Sequence[Driven]) -> tuple[shapely.Polygon, bool]:
    """The field in metres of the plan, and whether it is known: else a hull round what is planned."""
    asked = shown.scenario
    try:
        field = read_field(asked.field, local=asked.local, crs=asked.crs, swap=asked.swap)
        if field.crs == shown.saved.crs:
            return shapely.transform(field.boundary, lambda points: points + np.array(field.origin_m)), True
    except HeadlandError:
        pass
    hull = shapely.MultiPoint(np.concatenate([run.xy[run.works] for run in planned])).convex_hull.buffer(
        0.5 * asked.width_m
    )
    outlines = [run.outline for run in runs if run.outline is not None and run.outline.intersection(hull).area > 0.0]
    if outlines:
        return max(outlines, key=lambda one: float(one.intersection(hull).area)), True
    return hull, False


def _share_inside(run: Driven, field: shapely.Polygon) -> float:
    near = field.buffer(NEAR_M)
    shapely.prepare(near)
    return float(shapely.contains_xy(near, run.xy[:, 0], run.xy[:, 1]).mean())


def _name(runs: Sequence[Driven], shown: Shown) -> str:
    return next((run.field for run in runs if run.field), Path(shown.scenario.field).stem)


def _side(runs: Sequence[Driven], field: shapely.Polygon, width_m: float, behind_m: float, said: bool) -> Side:
    """All runs of a side together."""
    known = all(run.works_known for run in runs)
    width = next((run.width_m for run in runs if run.width_m), width_m)
    covered: Ground | None = ground(runs, field, width, behind_m) if said and known else None
    return Side(
        len(runs), _total([summary(run) for run in runs]),
        tuple(line for run in runs for line in tool_lines(run, 0.0)) if known else (),
        tuple(line for run in runs for line in _idle(run)), covered,
    )  # fmt: skip


def _idle(run: Driven) -> Iterator[Points]:
    for first, last in stretches(~run.works):
        line: Array = run.xy[max(first - 1, 0) : last + 1]
        if len(line) > 1:
            yield line


def _total(each: Sequence[Figures]) -> Figures:
    """The figures of several runs as of one: sums, and means over all that was driven."""
    kinds = {kind: sum(one.by_kind_s[kind] for one in each) for kind in each[0].by_kind_s}
    active = _sum([one.active_m for one in each])
    turning = [one for one in each if one.turning_mps]
    us = [(one.u_turns or 0, one.u_turn_s) for one in each if one.u_turn_s is not None]
    return Figures(
        seconds=sum(one.seconds for one in each),
        by_kind_s=kinds,
        active_m=active,
        inactive_m=_sum([one.inactive_m for one in each]),
        counted_m=_sum([one.counted_m for one in each]),
        placed_m=sum(one.placed_m for one in each),
        area_m2=_sum([one.area_m2 for one in each]),
        area_counted=all(one.area_counted for one in each),
        lifts=_whole([one.lifts for one in each]),
        turns=_whole([one.turns for one in each]),
        u_turns=_whole([one.u_turns for one in each]),
        u_turn_s=sum(n * s for n, s in us) / sum(n for n, _ in us) if us else None,
        stops=sum(one.stops for one in each),
        stops_s=sum(one.stops_s for one in each),
        working_mps=active / kinds[WORKING] if active and kinds[WORKING] else None,
        turning_mps=_mean_speed(turning),
        fuel_l=_sum([one.fuel_l for one in each]),
        width_m=each[0].width_m,
        rows=sum(one.rows for one in each),
    )


def _mean_speed(each: Sequence[Figures]) -> float | None:
    weights = [one.by_kind_s[TURNING] for one in each]
    if not sum(weights):
        return None
    return sum(w * (one.turning_mps or 0.0) for w, one in zip(weights, each, strict=True)) / sum(weights)


def _sum(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) if len(known) == len(values) else None


def _whole(values: Sequence[int | None]) -> int | None:
    known = [value for value in values if value is not None]
    return sum(known) if len(known) == len(values) else None


def _differences(planned: Figures, driven: Figures) -> Iterator[Difference]:
    """Parts that add up to the difference in machine time, the largest first.

    At work and in turns the part of how much is told from that of how fast: (b - a) x s and b x (t - s) add up to
    b x t - a x s, with a and b the lengths or counts and s and t the seconds that each takes.
    """
    known = driven.turns is not None
    ways, lost = (driven.by_kind_s[kind] - planned.by_kind_s[kind] for kind in (WAY, UNLOGGED))
    found = [Difference(UNLOGGED, lost, "moved without a log")]
    more = driven.by_kind_s[STANDING] - planned.by_kind_s[STANDING]
    found.append(Difference(STANDING, more, f"{driven.stops} stops, planned {planned.stops}"))
    if known:
        found += [Difference(WAY, ways, "on ways longer than a turn"), *_by_kind(planned, driven)]
    else:
        found.append(Difference("moving", driven.moving_s - planned.moving_s, "moving, at work or off it"))
    yield from sorted((one for one in found if abs(one.seconds) >= 1.0), key=lambda one: -abs(one.seconds))


def _by_kind(planned: Figures, driven: Figures) -> Iterator[Difference]:
    """How much and how fast at work, and in turns."""
    yield from _parts(
        WORKING, planned, driven, (planned.active_m, driven.active_m),
        "{driven:.0f} m at work, planned {planned:.0f} m", "at work {driven:.1f} km/h, planned {planned:.1f} km/h",
    )  # fmt: skip
    yield from _parts(
        TURNING, planned, driven, (planned.turns, driven.turns), "{driven:.0f} turns, planned {planned:.0f}",
        "{driven:.0f} s a turn, planned {planned:.0f} s",
    )  # fmt: skip


def _parts(
    kind: str, planned: Figures, driven: Figures, counts: tuple[float | None, float | None], much: str, fast: str
) -> Iterator[Difference]:
    """How much and how fast; one part alone where either side has none."""
    (a, b), (one, other) = counts, (planned.by_kind_s[kind], driven.by_kind_s[kind])
    if not a or not b or not one or not other:
        yield Difference(kind, other - one, f"time {kind}")
        return
    s, t = one / a, other / b
    yield Difference(kind, (b - a) * s, much.format(driven=b, planned=a))
    told = (3.6 / t, 3.6 / s) if kind == WORKING else (t, s)
    yield Difference(kind, b * (t - s), fast.format(driven=told[0], planned=told[1]))


def _notes(
    runs: Sequence[Driven], own: Sequence[Driven], shown: Shown, behind_m: float | None, said: bool
) -> Iterator[str]:
    if len(own) < len(runs):
        yield f"{some(len(runs) - len(own), 'run')} in other places left out."
    if not all(run.works_known for run in own):
        yield "Not every run says when the implement worked, so ground and work are not compared."
    if not said:
        yield "The field of the plan cannot be read here, so ground is not compared; put its file back."
    width = next((run.width_m for run in own if run.width_m), None)
    if width and abs(width - shown.scenario.width_m) > 0.05:
        yield f"Working width: {width:g} m by the logs, {shown.scenario.width_m:g} m by the plan; each side has its."
    if behind_m is None:
        return
    yield (
        f"Ground is what a tool of that width sweeps {behind_m:.1f} m behind the antenna, as the plan's tractor and "
        "implement have it; pieces narrower than 0.4 m are not drawn."
    )
