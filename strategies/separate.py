"""What strategies without formation share: every tractor has its own tracks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from fields.layout import Track
from strategies.errors import too_many
from strategies.job import Job, Pass
from strategies.legs import mission_of
from vehicle.missions import Mission, Plan


def lines_of(job: Job) -> list[list[Track]]:
    """The tracks of each line in order; raises StrategyError for more tractors than lines."""
    by_line: dict[int, list[Track]] = {}
    for track in job.layout.tracks:
        by_line.setdefault(track.line, []).append(track)
    lines = [by_line[line] for line in sorted(by_line)]
    if len(lines) < job.tractors:
        raise too_many(job.tractors, len(lines))
    return lines


def mission_in(job: Job, tractor: int, order: list[Pass]) -> Mission:
    """The mission of a tractor with tracks of its own; from the end to the beginning where the job has it turned."""
    if tractor in job.turned:
        order = [Pass(one.track, -one.direction) for one in order[::-1]]
    return mission_of(job, order)


def plan_of(job: Job, name: str, missions: Iterable[Mission], **notes: Any) -> Plan:
    """One mission per tractor as a plan that says which strategy wrote it, and what else there is to note."""
    return Plan(tuple(missions), {"strategy": name, "tractors": job.tractors, **notes})
