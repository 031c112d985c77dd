"""Drives that the tests of the twin share."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from vehicle.missions.plan import SWATH, Leg, LegTask, Mission
from vehicle.model.tractor import Implement, load_tractor
from vehicle.twin.robot_tractor import RobotState, RobotTractor
from vehicle.twin.step_motion import TractorNoise
from vehicle.twin.twin import PoseFix, Twin


def hook(speed_mps: float = 1.1) -> Mission:
    """Straight ahead, a quarter circle to the left, straight on: three legs."""
    angles = np.linspace(0.0, 0.5 * math.pi, 31)
    arc = np.stack([8.0 * np.cos(angles) - 8.0, 15.0 + 8.0 * np.sin(angles)], axis=1)
    first, last = np.array([[0.0, 0.0], [0.0, 15.0]]), np.array([[-8.0, 23.0], [-25.0, 23.0]])
    return Mission((
        Leg(first, speed_mps, implement=True, task=LegTask(SWATH)), Leg(arc, speed_mps),
        Leg(last, speed_mps, implement=True, task=LegTask(SWATH)),
    ))  # fmt: skip


def lay_rows(count: int) -> Mission:
    """Rows of 80 m at 5 km/h, the implement down on them, joined by half circles of 5 m radius."""
    legs: list[Leg] = []
    for number in range(count):
        x, up = 10.0 * number, number % 2 == 0
        begin, end = (0.0, 80.0) if up else (80.0, 0.0)
        legs.append(Leg(np.array([[x, begin], [x, end]]), 1.4, implement=True, task=LegTask(SWATH, number)))
        if number + 1 < count:
            angles = np.linspace(math.pi, 0.0 if up else 2.0 * math.pi, 31)
            legs.append(Leg(np.stack([x + 5.0 * (1.0 + np.cos(angles)), end + 5.0 * np.sin(angles)], axis=1), 1.4))
    return Mission(tuple(legs))


def fix_of(state: RobotState, age_s: float = 0.0) -> PoseFix:
    """The fix of a state, with an age."""
    return PoseFix(state.time_s, state.x_m, state.y_m, state.heading_rad, state.speed_mps, state.time_s + age_s)


@dataclass(frozen=True, eq=False)
class Followed:
    """Twin less truth at every frame: distance (m) and heading (rad), (k,) each; and the twin."""

    distance_m: np.ndarray
    heading_rad: np.ndarray
    twin: Twin


def follow(
    method: str,
    rate_hz: float,
    age_s: float,
    *,
    hidden: Mapping[str, float] | None = None,
    noise: TractorNoise | None = None,
    exact: bool = False,
    mission: Mission | None = None,
    master: str = "eg105",
) -> Followed:
    """A twin of the EG105 that follows a mission driven by a master; with `exact` it knows when commands changed."""
    mission = mission or hook()
    real = RobotTractor(mission, load_tractor(master), Implement(), hidden_effects=hidden, noise=noise, seed=3)
    real.base_legs = len(mission.legs)
    twin = Twin(load_tractor("eg105"), Implement(), fix_of(real.state), method=method)
    frames: list[RobotState] = []
    apart, step = [], 0
    while not real.state.done:
        step += 1
        if exact:
            real.advance((step - 1) / rate_hz + 0.5 / 60.0 + 1e-6)
            state = real.state
            twin.add_command((step - 1) / rate_hz, state.steering_command_rad, state.speed_command_mps, is_exact=True)
        now = step / rate_hz
        frames.append(real.advance(now))
        while frames and frames[0].time_s + age_s <= now + 1e-9:
            frame = frames.pop(0)
            twin.advance(frame.time_s + age_s)
            if not exact:
                twin.add_command(frame.time_s, frame.steering_command_rad, frame.speed_command_mps, frame.implement)
            twin.add_fix(fix_of(frame, age_s))
        mine, true = twin.advance(now), real.true_state
        apart.append((math.hypot(mine.x_m - true.x_m, mine.y_m - true.y_m), mine.heading_rad - true.heading_rad))
    table = np.array(apart)
    return Followed(table[:, 0], table[:, 1], twin)


@pytest.fixture(scope="session")
def following() -> Callable[..., Followed]:
    """`follow` with a cache, so that each drive runs once."""
    cache: dict[Any, Followed] = {}

    def follow_once(*words: Any, **more: Any) -> Followed:
        key = (words, tuple(sorted((name, str(value)) for name, value in more.items())))
        if key not in cache:
            cache[key] = follow(*words, **more)
        return cache[key]

    return follow_once
