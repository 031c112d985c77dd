"""Plans and parameters for the tests of the package `vehicle`."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest


class Build:
    """Builders of legs and plans for the tests; metres, x = east and y = north."""

    speed = 5.0 / 3.6

    def leg(self, *points: Sequence[float], **options: Any) -> Any:
        from vehicle.missions.plan import Leg, LegTask

        options.setdefault("speed_mps", self.speed)
        if "kind" in options:
            options["task"] = LegTask(options.pop("kind"))
        return Leg(np.array(points, dtype=np.float64), **options)

    def arc(self, centre: Sequence[float], radius: float, start_deg: float, end_deg: float, **options: Any) -> Any:
        """Arc about `centre` between two mathematical angles, one point per 2 degrees or so."""
        count = max(3, round(abs(end_deg - start_deg) / 2))
        angles = np.radians(np.linspace(start_deg, end_deg, count))
        points = np.stack([centre[0] + radius * np.cos(angles), centre[1] + radius * np.sin(angles)], axis=1)
        return self.leg(*points, **{"kind": "turn", **options})

    def plan(self, *missions: Sequence[Any]) -> Any:
        from vehicle.missions.plan import Mission, Plan

        return Plan(tuple(Mission(tuple(legs)) for legs in missions))

    def two_passes(self, x: float = 0.0, length: float = 30.0, spacing: float = 9.0, **turn: Any) -> list[Any]:
        """North along x, a half circle to the right, south along x + spacing."""
        work = {"kind": "track", "implement": True}
        half = 0.5 * spacing
        return [
            self.leg((x, 0), (x, length), **work),
            self.arc((x + half, length), half, 180, 0, **turn),
            self.leg((x + spacing, length), (x + spacing, 0), **work),
        ]

    def switch_back(self, radius: float = 4.5, length: float = 20.0) -> list[Any]:
        """North, a quarter to the right, straight back, a quarter to the right and south on the track 3 m aside."""
        back = 2 * radius - 3.0
        return [
            self.leg((0, 0), (0, length), kind="track", implement=True),
            self.arc((radius, length), radius, 180, 90),
            self.leg((radius, length + radius), (radius - back, length + radius), gear=-1, speed_mps=1.0, kind="turn"),
            self.arc((radius - back, length), radius, 90, 0),
            self.leg((3, length), (3, 0), kind="track", implement=True),
        ]


@pytest.fixture(scope="session")
def build() -> Build:
    return Build()


@pytest.fixture(scope="session")
def eg105() -> Any:
    from vehicle.model.tractor import load_tractor

    return load_tractor("eg105")


@pytest.fixture(scope="session")
def implement() -> Any:
    from vehicle.model.tractor import Implement

    return Implement(width_m=3.0, hitch_m=1.5, length_m=1.0)


@pytest.fixture(scope="session")
def model(eg105: Any, implement: Any) -> Any:
    from vehicle.sim.compile import build_model_record

    return np.array([build_model_record(eg105, implement)])[0]


@pytest.fixture(scope="session")
def soil() -> Any:
    from vehicle.model.ground import find_ground_index
    from vehicle.sim.compile import build_ground_records

    return build_ground_records()[find_ground_index("soil")]


@pytest.fixture(scope="session")
def north() -> float:
    """Mathematical angle of a body that heads north."""
    return 0.5 * math.pi
