"""`python -m tests.benchmarks.twins`: what twins cost, how seldom a right one is doubted, how soon a wrong one is.

Drives are rows of 80 m joined by half circles at 5 km/h; frames carry the noise of vehicle.twin.step_motion.Noise.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vehicle.missions.plan import SWATH, Leg, LegTask, Mission
from vehicle.model.tractor import Implement, Tractor, load_tractor
from vehicle.twin.robot_tractor import RobotState, RobotTractor
from vehicle.twin.step_motion import TractorNoise
from vehicle.twin.twin import PREDICT, PoseFix, Twin

SPEED_MPS, ROW_M, RADIUS_M = 1.4, 80.0, 5.0
LINKS = ((10.0, 0.05), (5.0, 0.1), (3.0, 0.3))  # rate (Hz) and age (s) of frames; more seldom nothing is doubted
HIDDEN: dict[str, float] = {
    "steering_offset": 1.0,
    "steering_gain": 0.92,
    "steering_asymmetry": 0.90,
    "steering_dead_time": 0.2,
    "steering_lag": 0.3,
    "steering_rate": 10.0,
    "steering_backlash": 1.5,
    "wheel_slip": 0.08,
    "implement_slip": 0.10,
    "implement_side_draft": 0.006,
    "heading_bias": 1.5,
    "antenna_forward": 0.4,
    "antenna_right": 0.15,
    "gnss_latency": 0.15,
}


def rows(count: int) -> Mission:
    """Rows one after another, the implement down on them, joined by half circles."""
    legs: list[Leg] = []
    for number in range(count):
        x, up = 2.0 * RADIUS_M * number, number % 2 == 0
        ends = (0.0, ROW_M) if up else (ROW_M, 0.0)
        line = np.array([[x, ends[0]], [x, ends[1]]])
        legs.append(Leg(line, SPEED_MPS, implement=True, task=LegTask(SWATH, number)))
        if number + 1 < count:
            angles = np.linspace(math.pi, 0.0 if up else 2.0 * math.pi, 31)
            arc = np.stack([x + RADIUS_M * (1.0 + np.cos(angles)), ends[1] + RADIUS_M * np.sin(angles)], axis=1)
            legs.append(Leg(arc, SPEED_MPS))
    return Mission(tuple(legs))


@dataclass(frozen=True)
class Watched:
    """A drive watched by a twin: how long (s), the twin, and the largest evidence on the way (s)."""

    seconds: float
    twin: Twin
    most: float


def frame_of(state: RobotState, age_s: float) -> PoseFix:
    """What comes in of a state."""
    return PoseFix(state.time_s, state.x_m, state.y_m, state.heading_rad, state.speed_mps, state.time_s + age_s)


def watch(
    tractor: Tractor,
    mission: Mission,
    seed: int,
    rate_hz: float,
    age_s: float,
    hidden: Mapping[str, float] | None = None,
    factor: float = 1.0,
) -> Watched:
    """Drive a mission with hidden effects and `factor` times the usual noise under a twin, until it doubts."""
    real = RobotTractor(
        mission, tractor, Implement(), hidden_effects=hidden, noise=TractorNoise().scale(factor), seed=seed
    )
    real.base_legs = len(mission.legs)
    twin = Twin(tractor, Implement(), frame_of(real.state, 0.0))
    step, most = 0, 0.0
    while not real.state.done and twin.find_mismatch() is None:
        step += 1
        state = real.advance(step / rate_hz)
        twin.add_command(state.time_s, state.steering_command_rad, state.speed_command_mps, state.implement)
        twin.add_fix(frame_of(state, age_s))
        twin.advance(state.time_s + age_s)
        most = max(most, twin.evidence_s)
    return Watched(real.time_s, twin, most)


def cost(tractor: Tractor, twins: int, seconds: float, steps_hz: float) -> float:
    """CPU seconds per second of so many twins, advanced at a rate, corrected once a second by fixes 0.3 s old."""
    mission = rows(2)
    real = RobotTractor(mission, tractor, Implement(), noise=TractorNoise())
    real.base_legs = len(mission.legs)
    states = [real.advance(k / 10.0) for k in range(round(10 * seconds) + 1)]
    fleet = [Twin(tractor, Implement(), frame_of(states[0], 0.0), method=PREDICT) for _ in range(twins)]
    begun = time.process_time()
    for k in range(round(seconds * steps_hz)):
        now = k / steps_hz
        frame = states[int(10.0 * now + 1e-9)]
        for twin in fleet:
            twin.add_command(frame.time_s, frame.steering_command_rad, frame.speed_command_mps, frame.implement)
            if k % round(steps_hz) == 0:
                twin.add_fix(frame_of(frame, 0.3))
            twin.advance(now)
    return (time.process_time() - begun) / seconds


def clean(tractor: Tractor, runs: int, factor: float) -> None:
    """Right twins: hours driven, alarms, and the largest evidence of any run."""
    for rate_hz, age_s in LINKS:
        seen = [watch(tractor, rows(8), seed, rate_hz, age_s, factor=factor) for seed in range(runs)]
        hours = sum(one.seconds for one in seen) / 3600.0
        alarms = sum(one.twin.find_mismatch() is not None for one in seen)
        print(
            f"{rate_hz:4g} Hz, {age_s:g} s old, noise x {factor:g}: {alarms} false alarms in {hours:.1f} h, "
            f"largest evidence {max(one.most for one in seen):.0f} s"
        )


def hidden(tractor: Tractor, seeds: int, rate_hz: float, age_s: float) -> None:
    """Wrong twins: the seconds until they are doubted, and what the doubt looks like."""
    print(f"{rate_hz:g} Hz, {age_s:g} s old: seconds until the doubt, of {seeds} drives each, and what it looks like")
    for name, value in HIDDEN.items():
        seen = [watch(tractor, rows(6), seed, rate_hz, age_s, {name: value}) for seed in range(seeds)]
        told = [doubt for one in seen if (doubt := one.twin.find_mismatch()) is not None]
        delays = sorted(doubt.detected_s for doubt in told)
        like = ", ".join(sorted({doubt.effect_id or "no direction" for doubt in told}))
        middle = f"{delays[len(delays) // 2]:6.1f}" if delays else "     -"
        print(f"  {name:22s} {value:6g}  {len(told)}/{seeds}  median {middle}  {like}")


def main() -> None:
    """Print all of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=30, help="clean runs per link, 9 minutes each")
    parser.add_argument("--seeds", type=int, default=3, help="drives per hidden effect")
    arguments = parser.parse_args()
    tractor = load_tractor("eg105")
    cost(tractor, 1, 2.0, 10.0)  # compiles
    for steps_hz in (10.0, 60.0):
        share = cost(tractor, 50, 10.0, steps_hz)
        print(f"50 twins, advanced {steps_hz:g} times a second, corrected at 1 Hz: {100 * share:.0f} % of a core")
    for factor in (1.0, 0.5):
        clean(tractor, arguments.runs, factor)
    for link in (LINKS[0], LINKS[-1]):
        hidden(tractor, arguments.seeds, *link)


if __name__ == "__main__":
    main()
