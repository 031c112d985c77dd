"""Honest robots with the faults of real ones: what is true of them, and what their receivers, wheels and clocks say.

Nothing here knows how the fleet manager judges. Drawn once for each robot: slip of up to a tenth that wanders, an
oblique heading, how it gains speed and brakes, and of what kind it is: speed of wheels or by satellites, fixes ten or
five times a second, raw or smoothed, progress by raw or by smoothed places, with or without an echo of heartbeats, and
a clock that is off, drifts and is set.
"""

import math

import numpy as np

from fields.arrays import Flags, Floats
from planner.fleet.model.tractor_state import AUTOMATIC, STOPPED
from planner.fleet.session.frame_timing import format_utc
from tests.benchmarks.honest_rows import BRAKE_MPS2, Blocks

STEP_S, EPOCH_S = 0.1, 1_700_000_000.0
LOST_PER_H, LOST_S, LEAPS_PER_H, LEAP_M = 6.0, 30.0, 240.0, (0.3, 1.0)  # corrections lost: a fix floats, and leaps
FLOAT_M, FLOAT_S = 0.3, 60.0  # of a fix that floats, per axis
FARTHEST_M = 1.0  # to which leaps lead
REFLECTED_M, REFLECTED_S = 0.01, 100.0  # correlated error of a good fix
WHITE_M, HEADING_RAD, OBLIQUE_RAD, SLIP = 0.012, 0.004, 0.03, 0.1
WHEELS_MPS, SATELLITES_MPS = 0.03, 0.05  # noise of speeds
OUTAGES_PER_H, OUTAGE_S = 3.0, 5.0  # without any fix: places by wheel turns
STOPS_PER_H, STOP_S = 15.0, 20.0  # of its own accord, for what it sees
CLOCK_SETS_PER_H, CLOCK_S, JITTER_S = 1.0, 0.3, 0.008
FRAME = (
    '{"kind": "state", "id": "robot %d", "sequence": %d, "time": "%s", "easting_m": %.3f, "northing_m": %.3f, '
    '"heading_deg": %.2f, "speed_mps": %.3f, "speed_command_mps": %.3f, "steering_command_deg": %.2f, '
    '"steering_deg": %.2f, "shuttle": %d, "start": %d, "leg": %d, "leg_m": %.3f, "implement": %d, "mode": "%s", '
    '"done": %s'
)
STEER_BACK_M = 5.0  # of driving, in which guidance brings what is shown back onto the path


def wander(values: Floats, sigma: float, memory_s: float, rng: np.random.Generator) -> Floats:
    """Values (n, ...) of a Gauss-Markov process a step later."""
    keep = math.exp(-STEP_S / memory_s)
    moved: Floats = keep * values + rng.normal(0.0, sigma * math.sqrt(1.0 - keep * keep), values.shape)
    return moved


def point(angles_rad: Floats) -> Floats:
    """Unit vectors (n, 2)."""
    return np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])


class HonestRobots:
    """The truth of a fleet and what it says of itself; arrays are by robot. Set from outside: whether it was ordered to
    stand, the end of its base (m), and the clock of the last heartbeat that it heard."""

    def __init__(self, blocks: Blocks, rng: np.random.Generator) -> None:
        self.blocks, self.rng, self.count = blocks, rng, blocks.plan.tractor_count
        self.is_standing, self.base_end_m = np.ones(self.count, dtype=bool), np.zeros(self.count)
        self.heartbeats_s: list[float | None] = [None] * self.count
        self._draw_kinds()
        zeros, zero_places = np.zeros(self.count), np.zeros((self.count, 2))
        self.at_m = self.speed_mps = self.aside_m = self.goal_mps = self.rear_mps = self.curvature = zeros
        self.along_m = self.leg_m = self.slip = self.lost_s = self.dark_s = self.stop_s = zeros
        self.error = self.shown_error = self.reflected = zero_places
        self.truth, self.heading_rad = blocks.find_poses(self.at_m)
        self.fix, self.gear, self.leg = self.truth, np.ones(self.count), np.zeros(self.count, dtype=np.int64)
        self.done, self.ticks, self.sequences = np.zeros(self.count, dtype=bool), 0, [-1] * self.count

    def _draw_kinds(self) -> None:
        rng, count = self.rng, self.count
        self.gait, self.gain_mps2 = rng.uniform(0.85, 1.0, count), rng.uniform(0.4, 1.0, count)
        self.brake_mps2 = rng.uniform(0.7, 1.5, count)
        self.usual_slip = rng.uniform(0.0, SLIP, count)
        self.oblique_rad = rng.uniform(-OBLIQUE_RAD, OBLIQUE_RAD, count)
        self.is_by_wheels, self.is_slow_receiver = rng.random(count) < 0.5, rng.random(count) < 0.3
        self.echoes = rng.random(count) < 0.7
        self.smooths_s = np.maximum(rng.choice([0.0, 1.0, 2.5], count), STEP_S)  # of fixes that change their kind
        self.progress_smooths_s = np.maximum(rng.choice([0.0, 1.0], count), STEP_S)
        self.clock_s = rng.normal(0.0, CLOCK_S, count).clip(-1.0, 1.0)
        self.drift = rng.uniform(-1e-4, 1e-4, count)

    def step(self) -> None:
        """Drive on for STEP_S."""
        self.ticks += 1
        moved = self._drive()
        self._err(moved)
        self._follow_progress()
        is_set = self._happens(CLOCK_SETS_PER_H)
        set_s = self.rng.normal(0.0, CLOCK_S, self.count).clip(-1.0, 1.0)
        self.clock_s = np.where(is_set, set_s, self.clock_s + self.drift * STEP_S)

    def _happens(self, per_h: float) -> Flags:
        return self.rng.random(self.count) < per_h * STEP_S / 3600.0

    def _drive(self) -> Floats:
        """Move along the path, beside it by what guidance corrects; how far each has moved (n, 2)."""
        blocks, starts = self.blocks, self._happens(STOPS_PER_H)
        self.stop_s = np.where(starts, self.rng.exponential(STOP_S, self.count), self.stop_s - STEP_S)
        left_m = np.maximum(self.base_end_m - self.at_m - self.along_m, 0.0)
        allowed_mps = np.interp(self.at_m, blocks.at_m, blocks.allowed_mps) * self.gait
        allowed_mps = np.minimum(allowed_mps, np.sqrt(2.0 * BRAKE_MPS2 * left_m))
        stands = self.is_standing | (self.stop_s > 0.0) | self.done
        self.goal_mps = np.where(stands | (allowed_mps < 0.05), 0.0, allowed_mps)
        change = np.clip(self.goal_mps - self.speed_mps, -self.brake_mps2 * STEP_S, self.gain_mps2 * STEP_S)
        self.speed_mps = np.maximum(self.speed_mps + change, 0.0)
        self.at_m = np.minimum(self.at_m + self.speed_mps * STEP_S, blocks.leg_starts_m[-1])
        places, path_rad = blocks.find_poses(self.at_m)
        aside = point(path_rad + 0.5 * math.pi)
        off_m = (self.shown_error * aside).sum(axis=1) - self.aside_m
        self.aside_m = self.aside_m + off_m * np.minimum(self.speed_mps * STEP_S / STEER_BACK_M, 1.0)
        truth = places - self.aside_m[:, None] * aside
        moved, self.truth = truth - self.truth, truth
        self.gear = blocks.find_gears(self.at_m)
        self._turn(moved)
        return moved

    def _turn(self, moved: Floats) -> None:
        """The rear axle follows the guided point, which is ahead of it."""
        length_m, forward_m = np.hypot(*moved.T), self.blocks.plan.tractor.antenna_forward_m
        course_rad = np.arctan2(moved[:, 1], moved[:, 0]) + np.where(self.gear > 0.0, 0.0, math.pi)
        off_rad = np.where(length_m > 1e-4, course_rad - self.heading_rad, 0.0)
        turned_rad = np.minimum(length_m / forward_m, 1.0) * np.sin(off_rad)
        rear_m = length_m * np.cos(off_rad - 0.5 * turned_rad)
        self.heading_rad = self.heading_rad + turned_rad
        self.rear_mps = np.maximum(rear_m, 0.0) / STEP_S
        self.curvature = np.where(rear_m > 0.01, turned_rad / np.maximum(rear_m, 0.01), self.curvature)

    def _err(self, moved: Floats) -> None:
        """What the receiver shows: reflections, a fix that floats and leaps, or none at all."""
        rng, count = self.rng, self.count
        loses = self._happens(LOST_PER_H) & (self.lost_s <= 0.0)
        self.lost_s = np.where(loses, rng.exponential(LOST_S, count), self.lost_s - STEP_S)
        leaps = loses | self._happens(LEAPS_PER_H)
        leap_m = point(rng.uniform(0.0, 2.0 * math.pi, count)) * (rng.uniform(*LEAP_M, count) * leaps)[:, None]
        leap_m = np.where(np.hypot(*(self.error + leap_m).T)[:, None] > FARTHEST_M, -leap_m, leap_m)
        self.error = (wander(self.error, FLOAT_M, FLOAT_S, rng) + leap_m) * (self.lost_s > 0.0)[:, None]
        share = (STEP_S / self.smooths_s)[:, None]
        self.shown_error = self.shown_error + share * (self.error - self.shown_error)
        self.reflected = wander(self.reflected, REFLECTED_M, REFLECTED_S, rng)
        self.slip = wander(self.slip, 0.01, 30.0, rng)
        self.dark_s = np.where(self._happens(OUTAGES_PER_H), OUTAGE_S, self.dark_s - STEP_S)
        fresh = self.truth + self.shown_error + self.reflected + rng.normal(0.0, WHITE_M, (count, 2))
        is_due = ~self.is_slow_receiver | (self.ticks % 2 == 0)
        counted = self.fix + moved / (1.0 - self._slips())[:, None]
        self.fix = np.where((self.dark_s > 0.0)[:, None], counted, np.where(is_due[:, None], fresh, self.fix))

    def _slips(self) -> Floats:
        slips: Floats = np.clip(self.usual_slip + self.slip, 0.0, SLIP)
        return slips

    def _follow_progress(self) -> None:
        """Progress by the place that is shown; legs never go back."""
        blocks = self.blocks
        _, path_rad = blocks.find_poses(self.at_m)
        ahead = point(path_rad) * self.gear[:, None]
        share = STEP_S / self.progress_smooths_s
        self.along_m = self.along_m + share * (((self.fix - self.truth) * ahead).sum(axis=1) - self.along_m)
        shown_m = np.clip(self.at_m + self.along_m, 0.0, np.maximum(self.base_end_m, 0.0))
        self.leg = np.maximum(self.leg, blocks.find_legs(np.maximum(shown_m - 1e-6, 0.0)))
        starts_m, ends_m = blocks.leg_starts_m[self.leg], blocks.leg_starts_m[self.leg + 1]
        self.leg_m = np.clip(shown_m, starts_m, ends_m) - starts_m
        is_at_end = (shown_m >= blocks.leg_starts_m[-1] - 0.1) & (self.speed_mps < 0.06)
        self.done = self.done | is_at_end

    def report_all(self, now: float) -> list[str]:
        """The next frame of each robot."""
        rng, count, plan = self.rng, self.count, self.blocks.plan
        headings_rad = self.heading_rad + self.oblique_rad + rng.normal(0.0, HEADING_RAD, count)
        wheels_mps = self.rear_mps / (1.0 - self._slips()) + rng.normal(0.0, WHEELS_MPS, count) * (self.speed_mps > 0.0)
        by_satellites_mps = np.hypot(*rng.normal(0.0, 0.01, (2, count)))
        driven_mps = self.rear_mps + rng.normal(0.0, SATELLITES_MPS, count)
        by_satellites_mps = np.where(self.speed_mps > 0.0, driven_mps, by_satellites_mps)
        speeds_mps = np.abs(np.where(self.is_by_wheels | (self.dark_s > 0.0), wheels_mps, by_satellites_mps))
        aside_m, (east, north) = plan.tractor.antenna_right_m, plan.saved.origin_m
        places = self.fix + (east, north) + aside_m * point(self.heading_rad - 0.5 * math.pi)
        steering_rad = -np.arctan(plan.tractor.wheelbase_m * self.curvature).clip(-0.7, 0.7)
        times_s = EPOCH_S + now + self.clock_s + rng.normal(0.0, JITTER_S, count)
        headings_deg = np.degrees(0.5 * math.pi - headings_rad) % 360.0
        is_working = np.array([bool(leg.implement) for leg in plan.timed_missions[0].legs])[self.leg]
        steering_deg = np.degrees(steering_rad)
        columns = (
            *places.T, headings_deg, speeds_mps, self.goal_mps, steering_deg, steering_deg, self.gear,
            self.goal_mps > 0.0, self.leg, self.leg_m, is_working,
        )  # fmt: skip
        rows = zip(*(column.tolist() for column in columns), strict=True)
        texts = []
        for number, (time_s, values) in enumerate(zip(times_s.tolist(), rows, strict=True)):
            self.sequences[number] += 1
            mode, done = STOPPED if self.is_standing[number] else AUTOMATIC, "true" if self.done[number] else "false"
            text = FRAME % (number + 1, self.sequences[number], format_utc(time_s), *values, mode, done)
            if self.echoes[number] and self.heartbeats_s[number] is not None:
                text += f', "heartbeat_s": {self.heartbeats_s[number]}'
            texts.append(text + "}")
        return texts
