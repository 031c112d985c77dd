"""The estimate of credible motion alone, for many hours of honest tractors: doubts that nobody's lie has caused.

python -m tests.benchmarks.clean_motion --hours 100        # of a fleet of 50; minutes
python -m tests.benchmarks.clean_motion --hours 1 --lie    # one that stands by its own words, to see that it is found

Each tractor drives swaths of 200 m and half circles of 5 m at 1 to 3 m/s with stops, reports ten times a second, and
steers by what its receiver shows. Positions have white noise; corrections are lost six times an hour for half a minute
on average, in which half of the receivers have an error that wanders from a value of its own, and the others a fix that
floats and leaps as in honest_robots, raw or smoothed; each hour the receiver is without a fix for 5 s three times, in
which the tractor counts wheel turns, and three times the link is away for 5 s and all states come after it. Progress is
by raw or by smoothed places. Speed is measured at the wheels, which slip by up to a tenth; headings are oblique and
noisy. Without doubts there can be no false alarm of one that drives on by its positions: such an alarm begins with a
doubt.
"""

import argparse
import math
import time
from typing import Any

import numpy as np

from planner.fleet.safety.credible_motion import (
    COLUMN_COUNT,
    KEPT_COUNT,
    PAIR_COUNT,
    REPORT_SIZE,
    add_motion_step,
    measure_motion_step,
)
from tests.benchmarks.honest_robots import FARTHEST_M, FLOAT_M, FLOAT_S, LEAP_M, LEAPS_PER_H
from vehicle.jit import compile_function

STEP_S, ANTENNA_M, OFF_LEG_M = 0.1, 0.0, 3.0
SWATH_M, RADIUS_M = 200.0, 5.0
WHITE_M, WANDER_M, WANDER_S = 0.012, 0.5, 60.0
LOST_PER_H, LOST_S, OUTAGES_PER_H, OUTAGE_S = 6.0, 30.0, 3.0, 5.0
SLIP, OBLIQUE_RAD, HEADING_RAD, SPEED_NOISE_MPS = 0.1, 0.03, 0.004, 0.03
SMOOTHS_S, PROGRESS_SMOOTHS_S, SLOW_SHARE = (STEP_S, 1.0, 2.5), (STEP_S, 1.0), 0.3


@compile_function
def find_pose(at_m: float, pose: Any) -> None:
    """The pose of a tractor that goes to and fro, at a distance along its path."""
    bend_m = math.pi * RADIUS_M
    row, rest_m = divmod(at_m, SWATH_M + bend_m)
    way = 1.0 if row % 2.0 == 0.0 else -1.0
    if rest_m < SWATH_M:
        pose[0], pose[1] = 2.0 * RADIUS_M * row, rest_m if way > 0.0 else SWATH_M - rest_m
        pose[2] = way * 0.5 * math.pi
        return
    angle = (rest_m - SWATH_M) / RADIUS_M
    pose[0] = 2.0 * RADIUS_M * row + RADIUS_M * (1.0 - math.cos(angle))
    pose[1] = (SWATH_M if way > 0.0 else 0.0) + way * RADIUS_M * math.sin(angle)
    pose[2] = way * (0.5 * math.pi - angle)


@compile_function
def float_on(error: Any, is_lost: bool, leaps: bool) -> None:
    """Move the error (2,) of a fix that floats while corrections are lost, with a leap or without."""
    if not is_lost:
        error[:] = 0.0
        return
    keep = math.exp(-STEP_S / FLOAT_S)
    for axis in range(2):
        error[axis] = keep * error[axis] + np.random.normal(0.0, FLOAT_M * math.sqrt(1.0 - keep * keep))
    if leaps:
        way_rad, leap_m = np.random.uniform(0.0, 2.0 * math.pi), np.random.uniform(LEAP_M[0], LEAP_M[1])
        x_m, y_m = leap_m * math.cos(way_rad), leap_m * math.sin(way_rad)
        sign = -1.0 if math.hypot(error[0] + x_m, error[1] + y_m) > FARTHEST_M else 1.0
        error[0], error[1] = error[0] + sign * x_m, error[1] + sign * y_m


@compile_function
def wander_on(error_m: float, is_lost: bool, keep: float) -> float:
    """The error of a fix along one axis, which wanders while corrections are lost and is none otherwise."""
    spread_m = WANDER_M * math.sqrt(1.0 - keep * keep)
    return keep * error_m + np.random.normal(0.0, spread_m) if is_lost else 0.0


@compile_function
def raises_doubt(before, report, biases_m, step, sums, kept, counts, found) -> bool:  # type: ignore[no-untyped-def]
    """Whether a report after the one before it raises a doubt, after which the sums begin anew."""
    if counts[0] == 0:
        counts[0] = 1
        return False
    measure_motion_step(before, report, ANTENNA_M, step)
    add_motion_step(step, biases_m, True, sums, kept, counts, found)
    if found.max() < 0:
        return False
    sums[:], counts[0], counts[1] = 0.0, 1, 0
    kept[0] = sums
    return True


@compile_function
def drive(seed: int, steps: int, lies_from: int) -> tuple[int, int]:
    """The doubts of one tractor in so many steps, and the first step of one (-1 for none)."""
    np.random.seed(seed)
    report, before, step = np.zeros(REPORT_SIZE), np.full(REPORT_SIZE, np.nan), np.zeros(COLUMN_COUNT)
    sums, kept = np.zeros(COLUMN_COUNT), np.zeros((KEPT_COUNT, COLUMN_COUNT))
    counts, found = np.zeros(2, dtype=np.int64), np.full(PAIR_COUNT, -1)
    biases_m, pose = np.array([0.0, OFF_LEG_M, OFF_LEG_M]), np.zeros(3)
    error, shown_error, shown, steered = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    truth, moved, progress, along_m = np.zeros(2), np.zeros(2), np.zeros(3), 0.0
    floats, is_slow = np.random.random() < 0.5, np.random.random() < SLOW_SHARE
    share = STEP_S / SMOOTHS_S[np.random.randint(3)] if floats else 1.0
    progress_share = STEP_S / PROGRESS_SMOOTHS_S[np.random.randint(2)]
    counted = np.zeros(2)
    slip, oblique = np.random.uniform(0.0, SLIP), np.random.uniform(-OBLIQUE_RAD, OBLIQUE_RAD)
    goal_mps, speed_mps, at_m = np.random.uniform(1.0, 3.0), 0.0, 0.0
    lost_s = dark_s = away_s = stands_s = 0.0
    keep, doubts, first = math.exp(-STEP_S / WANDER_S), 0, -1
    for number in range(steps):
        leaps = np.random.random() < LEAPS_PER_H * STEP_S / 3600.0
        if lost_s <= 0.0 and np.random.random() < LOST_PER_H * STEP_S / 3600.0:
            lost_s, leaps = np.random.exponential(LOST_S), True
            if not floats:
                error[0], error[1] = np.random.normal(0.0, WANDER_M), np.random.normal(0.0, WANDER_M)
        if np.random.random() < OUTAGES_PER_H * STEP_S / 3600.0:
            dark_s = OUTAGE_S
        if np.random.random() < OUTAGES_PER_H * STEP_S / 3600.0:
            away_s = OUTAGE_S
        if np.random.random() < STEP_S / 120.0:
            stands_s = np.random.exponential(20.0)
        lost_s, dark_s, away_s, stands_s = lost_s - STEP_S, dark_s - STEP_S, away_s - STEP_S, stands_s - STEP_S
        change = -0.7 if stands_s > 0.0 else 0.7
        speed_mps = min(max(speed_mps + change * STEP_S, 0.0), goal_mps)
        at_m += speed_mps * STEP_S
        find_pose(at_m, pose)
        if floats:
            float_on(error, lost_s > 0.0, leaps)
        for axis in range(2):
            if not floats:
                error[axis] = wander_on(error[axis], lost_s > 0.0, keep)
            # guidance steers what is shown back onto the path, within the metres that it takes to do so
            shown_error[axis] += share * (error[axis] - shown_error[axis])
            offset = shown_error[axis] - steered[axis]
            steered[axis] += offset * min(speed_mps * STEP_S / 5.0, 1.0)
            moved[axis] = pose[axis] - steered[axis] - truth[axis]
            truth[axis] += moved[axis]
            fix = truth[axis] + shown_error[axis] + np.random.normal(0.0, WHITE_M)
            if dark_s > 0.0:
                shown[axis] = counted[axis]
            elif not is_slow or number % 2 == 0:
                shown[axis] = fix
        looks = speed_mps > 0.0 and number > 0  # where it drives
        course = math.atan2(moved[1], moved[0]) if looks else pose[2]
        heading = course + oblique + np.random.normal(0.0, HEADING_RAD)
        wheels_mps = math.hypot(moved[0], moved[1]) / STEP_S * (1.0 + slip) if number > 0 else 0.0
        said_mps = abs(wheels_mps + np.random.normal(0.0, SPEED_NOISE_MPS)) if speed_mps > 0.0 else 0.0
        counted[0] = shown[0] + wheels_mps * STEP_S * math.cos(heading)
        counted[1] = shown[1] + wheels_mps * STEP_S * math.sin(heading)
        if lies_from >= 0 and number >= lies_from:
            said_mps = 0.0
        report[0], report[1], report[2], report[3], report[4] = number * STEP_S, shown[0], shown[1], heading, said_mps
        ahead_m = (shown[0] - truth[0]) * math.cos(pose[2]) + (shown[1] - truth[1]) * math.sin(pose[2])
        along_m += progress_share * (ahead_m - along_m)
        find_pose(max(at_m + along_m, 0.0), progress)
        report[5], report[6], report[7] = progress[0], progress[1], progress[2]
        if away_s > 0.0 and number % 2 == 0:
            continue  # of the states that waited for the link only every second is kept
        if raises_doubt(before, report, biases_m, step, sums, kept, counts, found):
            doubts += 1
            first = number if first < 0 else first
        before[:] = report
    return doubts, first


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=100.0)
    parser.add_argument("--tractors", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--lie", action="store_true")
    choice = parser.parse_args()
    begun_s, doubts = time.perf_counter(), 0
    for number in range(choice.tractors):
        steps = round(choice.hours * 3600.0 / STEP_S)
        lies_from = steps // 2 if choice.lie else -1
        of_one, first = drive(1000 * choice.seed + number, steps, lies_from)
        doubts += of_one
        after_s = f", the first after {(first - max(lies_from, 0)) * STEP_S:.1f} s" if of_one else ""
        print(f"tractor {number + 1}: {of_one} doubts{after_s}; {time.perf_counter() - begun_s:.0f} s", flush=True)
    hours = choice.tractors * choice.hours
    print(f"{doubts} doubts in {hours:.0f} h of driving; {time.perf_counter() - begun_s:.0f} s")


if __name__ == "__main__":
    main()
