"""Jobs on plain fields that the tests of the strategies share; metres, x = east and y = north."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import affinity, box

from fields import Field, Layout, Track, lay_tracks
from strategies.job import Job, Manner, starting_corner
from strategies.ways.connect import Connector, TurnCosts
from vehicle.missions import Plan

WIDTH_M, HEADLAND_M, RADIUS_M, TOOL_M = 3.0, 9.0, 4.3, 2.3
Spans = Sequence[Sequence[tuple[float, float]]]


class Jobs:
    """Ways to make a job, and to see what a plan works."""

    width_m, headland_m, radius_m, tool_m = WIDTH_M, HEADLAND_M, RADIUS_M, TOOL_M

    def manner(self, **changes: Any) -> Manner:
        values: dict[str, Any] = {
            "work_speed_mps": 1.5,
            "turn_speed_mps": 1.5,
            "reverse_speed_mps": 1.0,
            "radius_m": RADIUS_M,
            "tool_m": TOOL_M,
            "turn_s": (0.0, 30.0, 26.0, 14.0, 16.0),
        }
        return Manner(**values | changes)

    def on_field(self, field: Field, tractors: int = 1, bearing_deg: float | None = None, **manner: Any) -> Job:
        """A job on a field with tracks as they are really laid."""
        layout = lay_tracks(field, WIDTH_M, HEADLAND_M, bearing_deg)
        free = field.boundary.buffer(-0.5 * WIDTH_M, join_style="mitre")
        costs = TurnCosts(1.5, 1.0, 4.0)
        return Job(
            layout, self.manner(**manner), Connector(free, RADIUS_M, costs), tractors, None, starting_corner(layout)
        )

    def rectangle(
        self, lines: int, length_m: float = 80.0, tractors: int = 1, entrance: tuple[float, float] | None = None,
        hole: shapely.Polygon | None = None, **manner: Any,
    ) -> Job:  # fmt: skip
        """North-south tracks of a length on a rectangle; line 0 is not promised to be in the west."""
        outline = box(0, 0, lines * WIDTH_M, length_m + 2 * HEADLAND_M)
        if hole is not None:
            outline = outline.difference(hole)
        return self.on_field(Field("rectangle", outline, entrance=entrance), tractors, 0.0, **manner)

    def drawn(self, spans: Spans, tractors: int = 1, bearing_rad: float = 0.0, **manner: Any) -> Job:
        """Tracks given as spans along every line; for orders, which need no way between them."""
        cosine, sine = math.cos(bearing_rad), math.sin(bearing_rad)

        def turn(x: float, y: float) -> tuple[float, float]:
            return x * cosine - y * sine, x * sine + y * cosine

        tracks = tuple(
            Track(line, piece, turn(a, WIDTH_M * line), turn(b, WIDTH_M * line))
            for line, pieces in enumerate(spans)
            for piece, (a, b) in enumerate(pieces)
        )
        outline = affinity.rotate(box(-50, -50, 2000, 500), math.degrees(bearing_rad), origin=(0, 0))
        layout = Layout(Field("drawn", outline), bearing_rad, WIDTH_M, HEADLAND_M, tracks, outline)
        connector = Connector(outline, RADIUS_M, TurnCosts(1.5, 1.0, 4.0))
        return Job(layout, self.manner(**manner), connector, tractors)

    def worked(self, job: Job, plan: Plan) -> dict[Track, list[tuple[float, float, int]]]:
        """For each track the stretches worked on it: metres from its start, and the tractor, in order.

        Every working leg must lie on one track and be driven at working speed, the implement `tool_m` behind.
        """
        worked: dict[Track, list[tuple[float, float, int]]] = {track: [] for track in job.layout.tracks}
        for tractor, mission in enumerate(plan.missions):
            for leg in (leg for leg in mission.legs if leg.implement):
                assert leg.task.kind == "track" and leg.gear == 1 and leg.speed_mps == job.manner.work_speed_mps
                ahead = (leg.points[-1] - leg.points[0]) / np.linalg.norm(leg.points[-1] - leg.points[0])
                bar = leg.points[[0, -1]] - job.manner.tool_m * ahead
                track, low, high = self._on_track(job, bar)
                assert (leg.task.number, leg.task.piece) == (track.line, track.piece)
                worked[track].append((low, high, tractor))
        return {track: sorted(stretches) for track, stretches in worked.items()}

    def _on_track(self, job: Job, bar: Any) -> tuple[Track, float, float]:
        matches = []
        for track in job.layout.tracks:
            start, end = np.array(track.start), np.array(track.end)
            along = (end - start) / track.length
            offset = bar - start
            place, aside = offset @ along, np.abs(offset @ np.array([-along[1], along[0]]))
            if aside.max() < 1e-6 and place.min() > -1e-6 and place.max() < track.length + 1e-6:
                matches.append((track, float(place.min()), float(place.max())))
        assert len(matches) == 1, f"a working leg lies on {len(matches)} tracks"
        return matches[0]

    def assert_all_once(self, job: Job, plan: Plan) -> None:
        """Every metre of every track is worked exactly once, each track by one tractor."""
        for track, stretches in self.worked(job, plan).items():
            assert len({tractor for _, _, tractor in stretches}) == 1
            edges = [0.0, *(edge for low, high, _ in stretches for edge in (low, high)), track.length]
            assert np.allclose(edges[0::2], edges[1::2], atol=1e-6), f"line {track.line}: {stretches}"


@pytest.fixture(scope="session")
def jobs() -> Jobs:
    return Jobs()


@pytest.fixture(scope="session")
def same_pose() -> Callable[[Sequence[float], Sequence[float]], bool]:
    """Whether two poses (x, y, angle) are one."""

    def same(a: Sequence[float], b: Sequence[float]) -> bool:
        return math.dist(a[:2], b[:2]) < 1e-6 and abs(math.remainder(a[2] - b[2], 2 * math.pi)) < 1e-6

    return same
