"""Jobs on plain fields that the tests of the strategies share; metres, x = east and y = north."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import pytest
import shapely
from shapely import affinity, box

from fields import Field, Layout, Swath, lay_swaths
from strategies.path_planning.connector import Connector, TurnCosts
from strategies.program.field_job import DrivingRules, FieldJob

WIDTH_M, HEADLAND_M, RADIUS_M, TOOL_M = 3.0, 9.0, 4.3, 2.3
Spans = Sequence[Sequence[tuple[float, float]]]


class Jobs:
    """Ways to make a job."""

    width_m, headland_m, radius_m, tool_m = WIDTH_M, HEADLAND_M, RADIUS_M, TOOL_M

    def make_driving_rules(self, **changes: Any) -> DrivingRules:
        values: dict[str, Any] = {
            "work_speed_mps": 1.5,
            "turn_speed_mps": 1.5,
            "reverse_speed_mps": 1.0,
            "radius_m": RADIUS_M,
            "tool_m": TOOL_M,
            "turn_s": (0.0, 30.0, 26.0, 14.0, 16.0),
        }
        return DrivingRules(**values | changes)

    def on_field(
        self, field: Field, tractors: int = 1, bearing_deg: float | None = None, **driving_rules: Any
    ) -> FieldJob:
        """A job on a field with tracks as they are really laid."""
        layout = lay_swaths(field, WIDTH_M, HEADLAND_M, bearing_deg)
        free = field.boundary.buffer(-0.5 * WIDTH_M, join_style="mitre")
        costs = TurnCosts(1.5, 1.0, 4.0)
        return FieldJob(layout, self.make_driving_rules(**driving_rules), Connector(free, RADIUS_M, costs), tractors)

    def rectangle(
        self,
        lines: int,
        length_m: float = 80.0,
        tractors: int = 1,
        entrance: tuple[float, float] | None = None,
        hole: shapely.Polygon | None = None,
        **driving_rules: Any,
    ) -> FieldJob:
        """North-south tracks of a length on a rectangle; line 0 is not promised to be in the west."""
        outline = box(0, 0, lines * WIDTH_M, length_m + 2 * HEADLAND_M)
        if hole is not None:
            outline = outline.difference(hole)
        return self.on_field(Field("rectangle", outline, entrance=entrance), tractors, 0.0, **driving_rules)

    def drawn(self, spans: Spans, tractors: int = 1, bearing_rad: float = 0.0, **driving_rules: Any) -> FieldJob:
        """Tracks given as spans along every line; for orders, which need no way between them."""
        cosine, sine = math.cos(bearing_rad), math.sin(bearing_rad)

        def turn(x: float, y: float) -> tuple[float, float]:
            return x * cosine - y * sine, x * sine + y * cosine

        swaths = tuple(
            Swath(line, piece, turn(a, WIDTH_M * line), turn(b, WIDTH_M * line))
            for line, pieces in enumerate(spans)
            for piece, (a, b) in enumerate(pieces)
        )
        outline = affinity.rotate(box(-50, -50, 2000, 500), math.degrees(bearing_rad), origin=(0, 0))
        layout = Layout(Field("drawn", outline), bearing_rad, WIDTH_M, HEADLAND_M, swaths, outline)
        connector = Connector(outline, RADIUS_M, TurnCosts(1.5, 1.0, 4.0))
        return FieldJob(layout, self.make_driving_rules(**driving_rules), connector, tractors)


@pytest.fixture(scope="session")
def jobs() -> Jobs:
    return Jobs()


@pytest.fixture(scope="session")
def same_pose() -> Callable[[Sequence[float], Sequence[float]], bool]:
    """Whether two poses (x, y, angle) are one."""

    def same(a: Sequence[float], b: Sequence[float]) -> bool:
        return math.dist(a[:2], b[:2]) < 1e-6 and abs(math.remainder(a[2] - b[2], 2 * math.pi)) < 1e-6

    return same
