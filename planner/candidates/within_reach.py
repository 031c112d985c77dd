"""Tracks and rounds that a tractor can get to from the rest; what none leads to is left out, and told."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import shapely

from fields.layout import Track
from fields.rounds import Round
from strategies.errors import NoWayError
from strategies.job import Job

MOST_LEFT_OUT = 0.1  # of the length of all tracks: where more is out of reach the field is refused
MOST_TRIES = 8
Built = TypeVar("Built")


@dataclass(frozen=True)
class Reached:
    """A job without what is out of reach, and the metres of tracks and rounds that were left out."""

    job: Job
    tracks: int = 0
    tracks_m: float = 0.0
    rounds_m: float = 0.0

    @property
    def told(self) -> str | None:
        """The remark on what is left out, None where nothing is."""
        parts = []
        if self.tracks:
            parts.append(f"{self.tracks} piece{'s' if self.tracks > 1 else ''} of track ({self.tracks_m:.0f} m)")
        if self.rounds_m:
            parts.append(f"{self.rounds_m:.0f} m of rounds")
        return f"{' and '.join(parts)} left out, as no way leads there; a wider way or headland may" if parts else None

    def without(self, track: Track) -> Reached:
        """The same without one more track."""
        layout = self.job.layout
        tracks = tuple(each for each in layout.tracks if each is not track)
        job = replace(self.job, layout=replace(layout, tracks=tracks), used={})
        return replace(self, job=job, tracks=self.tracks + 1, tracks_m=self.tracks_m + track.length)


def within_reach(job: Job) -> Reached:
    """The job on that part of the ground, among those no way leads between, that holds most of the tracks."""
    parts = [part for part in shapely.get_parts(job.connector.free).tolist() if isinstance(part, shapely.Polygon)]
    reached = Reached(job)
    if len(parts) < 2 or not job.layout.tracks:
        return reached
    home = [_nearest(parts, shapely.LineString([track.start, track.end])) for track in job.layout.tracks]
    length = [math.fsum(t.length for t, part in zip(job.layout.tracks, home, strict=True) if part == n)
              for n in range(len(parts))]  # fmt: skip
    main = max(range(len(parts)), key=lambda n: round(length[n], 3))
    if math.fsum(length) - length[main] > MOST_LEFT_OUT * math.fsum(length):
        return reached
    for track, part in zip(job.layout.tracks, home, strict=True):
        reached = reached if part == main else reached.without(track)
    kept: list[Round] = [lap for lap in job.rounds if _nearest(parts, lap.line) == main]
    left_m = math.fsum(lap.length_m for lap in job.rounds) - math.fsum(lap.length_m for lap in kept)
    return replace(reached, job=replace(reached.job, rounds=tuple(kept)), rounds_m=left_m)


def _nearest(parts: list[shapely.Polygon], line: shapely.Geometry) -> int:
    """The part of the ground that holds most of a line, or else is nearest to it."""
    return min(
        range(len(parts)),
        key=lambda n: (-round(parts[n].intersection(line).length, 3), round(parts[n].distance(line), 3)),
    )


def built_within_reach(job: Job, build: Callable[[Job], Built]) -> tuple[Built, Reached]:
    """What `build` writes for the job, with short pieces left out that no way leads to; raises StrategyError."""
    reached = within_reach(job)
    whole_m = job.layout.total_m
    for _ in range(MOST_TRIES):
        try:
            return build(reached.job), reached
        except NoWayError as error:
            short = min(error.tracks, key=lambda track: (round(track.length, 3), track.line, track.piece))
            if reached.tracks_m + short.length > MOST_LEFT_OUT * whole_m:
                raise
            reached = reached.without(short)
    return build(reached.job), reached
