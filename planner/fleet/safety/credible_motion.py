"""What a tractor credibly does: three witnesses of its motion, and whether they agree.

Each report shows a displacement three times: by its positions, by its speed along its heading, and by its progress on
its leg. While a tractor tells the truth, two of them differ over any time by no more than their noise. The noise is
that of honest tractors, the worst of it always assumed, as a report does not say how good its fix is:

- a fix has white noise, and an error that wanders (Gauss-Markov) as without corrections of the base (RTK lost);
- a report has the last fix, which is old where the receiver has fewer fixes than the tractor reports;
- the error may leap when corrections are lost or come back: a step that noise does not explain is left out of the
  displacement, but not of a second sum, which may reach what two unrelated errors differ by, and no more; one leap that
  noise could explain is allowed for besides;
- a receiver that smooths a leap goes over to it ever more slowly, see `is_growing`, and at its full rate at once, see
  `has_set_out`: what does not grow steadily, and who sets out faster than tractors do, is held to the limit of that
  second sum only;
- speed over ground and heading are off by a share of the distance: slip, side slip, an oblique antenna;
- a tractor may be beside its leg by as much as the rules let it resume.

The limit of each difference follows from that noise and from FALSE_DOUBT_H, see `compute_limit_m`. What exceeds it is a
doubt: it says what each witness shows, from when and where the tractor may be anywhere that its last credible speed
leads to.

How much time is between two reports is what the tractor's clock says, as reports that waited for a link come all at
once, but no more than the service's clock allows: a clock that goes back, or leaps ahead of the arrivals, does not
count. Over a longer gap the speed in between is unknown by as much as a tractor can change it.
"""

from __future__ import annotations

import math

import numpy as np

from fields.arrays import Floats
from fields.units import HOUR_S, KMH_PER_MPS
from planner.fleet.model.rules import STATE_PERIOD_S
from planner.fleet.model.tractor_state import AUTOMATIC, POSITIONS, PROGRESS, SPEED, MotionDoubt, TractorReport
from vehicle.jit import compile_function

FIX_M = 0.02  # per axis, of one fix: RTK as in TractorNoise, with heading on the lever arm and rounding
FIX_AGE_S = 0.2  # of a receiver with five fixes a second, the fewest to steer by
UNCORRECTED_M, MEMORY_S = 0.5, 60.0  # per axis, of an error without corrections, and how long it lasts
MOTION_SHARE = 0.15  # of the distance: slip of ordinary work and side slip on slopes
FALSE_DOUBT_H = 1e4  # of driving between two false doubts of one tractor, at least
OCTAVES, PAIR_COUNT = 9, 3  # tests of a report: times from 0.2 s to 64 s, pairs of witnesses
NOISE_SIGMAS = math.sqrt(2.0 * math.log(FALSE_DOUBT_H * HOUR_S / STATE_PERIOD_S * OCTAVES * PAIR_COUNT))
"""Of a difference in two dimensions: exceeded once in so many tests (Rayleigh distribution)."""
FARTHEST_M = NOISE_SIGMAS * math.sqrt(2.0 * (FIX_M**2 + UNCORRECTED_M**2))
"""What two unrelated errors of a receiver differ by at most: it shows nobody who stands farther from where it stood."""
KEPT_S, KEPT_COUNT, STRIDE = 0.2, 320, 4
LONGEST_STEP_S = 1.0  # between two reports over which speed is steady; a link that is silent for longer is broken
SPEED_CHANGE_MPS2 = 1.0  # of tractors that gain speed or brake by service brake, over longer gaps
FASTEST_MPS = 50.0 / KMH_PER_MPS  # of tractors on fields
STILL_SHARE = 1.5  # of the time in which motion was found: without it for half of that, it has ended
RECENT_PARTS, GROWING_SHARE = 3, 0.95  # of a time, in whose last part a difference that is motion grows as on average
SMOOTHED_S = 2.5  # in which receivers go over to a fix of another kind, at most
PAIR_NOISE_M = math.sqrt(2.0) * FIX_M  # of the difference of two fixes along one axis: motion exceeds it
TIME, POSITION, DRIVEN, LEG, RAW_POSITION, DISTANCE, SLACK, TURN, PACE = 0, 1, 3, 5, 7, 9, 10, 11, 12
COLUMN_COUNT = PACE + 1
REPORT_SIZE = 8
NOWHERE = np.full(3, math.nan)  # the pose of a progress that follows no leg
PAIRS = np.array([[POSITION, DRIVEN], [POSITION, LEG], [LEG, DRIVEN]])


@compile_function
def compute_limit_m(age_s: float, distance_m: float) -> float:
    """By how much two witnesses may differ after `age_s` in which the tractor drove `distance_m`."""
    wander = UNCORRECTED_M * UNCORRECTED_M * (1.0 - math.exp(-age_s / MEMORY_S))
    return NOISE_SIGMAS * math.sqrt(2.0 * (FIX_M * FIX_M + wander)) + MOTION_SHARE * distance_m


@compile_function
def compute_doubt_m(age_s: float, distance_m: float, pace_mps: float) -> float:
    """By how much two witnesses differ for a doubt: more than noise explains, with the age of fixes at this speed, and
    with one leap that was taken for noise."""
    old_m = FIX_AGE_S * pace_mps
    return compute_limit_m(age_s, distance_m) + old_m + compute_limit_m(STATE_PERIOD_S, 0.0) + old_m


@compile_function
def measure_growth(sums, kept, since, until, a, b):  # type: ignore[no-untyped-def]
    """Seconds from one entry of the ring to another, and by how much the difference of two witnesses grew then (m):
    along what it is now since the first of them, and to its left; -1 for `until` is now."""
    then = kept[since]
    x_m, y_m = sums[a] - sums[b] - then[a] + then[b], sums[a + 1] - sums[b + 1] - then[a + 1] + then[b + 1]
    length_m = max(math.hypot(x_m, y_m), 1e-9)
    last = sums if until < 0 else kept[until]
    grown_x_m = last[a] - last[b] - then[a] + then[b]
    grown_y_m = last[a + 1] - last[b + 1] - then[a + 1] + then[b + 1]
    along_m, left_m = x_m * grown_x_m + y_m * grown_y_m, x_m * grown_y_m - y_m * grown_x_m
    return last[TIME] - then[TIME], along_m / length_m, left_m / length_m


@compile_function
def is_growing(sums, kept, count, back, a, b) -> bool:  # type: ignore[no-untyped-def]
    """Whether the difference of two witnesses has grown steadily since `back` entries of `count`, as motion does.

    After its first part of three and before its last (RECENT_PARTS) it was as far as on average or farther, and no
    farther aside than the middle of an arc by which the tractor turned: leaps that follow one another go their own
    ways. In the last it has grown about as much as on average. A leap by L that a receiver smooths over SMOOTHED_S
    leads to L (1 - exp(-t / SMOOTHED_S)), of which the last part of any time since it began has a smaller share:
    motion has more there by what is told from noise, over the whole time and over every shorter one in which that could
    be told. In less time than has such parts it is faster than tractors are, as by a clock that stands.
    """
    whole = back
    if whole < RECENT_PARTS:
        age_s, length_m, _ = measure_growth(sums, kept, (count - back) % len(kept), -1, a, b)
        return bool(length_m > FASTEST_MPS * age_s)
    while back >= RECENT_PARTS:
        part, since = back // RECENT_PARTS, (count - back) % len(kept)
        age_s, length_m, _ = measure_growth(sums, kept, since, -1, a, b)
        before_s, before_m, _ = measure_growth(sums, kept, since, (count - part) % len(kept), a, b)
        grown_m, even_m = length_m - before_m, length_m * (1.0 - before_s / age_s)
        faded = math.exp(-age_s / SMOOTHED_S)
        leap_m = length_m * (math.exp(-before_s / SMOOTHED_S) - faded) / (1.0 - faded)
        if (back == whole or even_m - leap_m >= 2.0 * PAIR_NOISE_M) and grown_m < leap_m + PAIR_NOISE_M:
            return False
        if back == whole:
            if grown_m < GROWING_SHARE * even_m:
                return False
            arc_m = length_m * abs(sums[TURN] - kept[since, TURN]) / 8.0
            for until in (count - back + part, count - part):
                then_s, then_m, left_m = measure_growth(sums, kept, since, until % len(kept), a, b)
                is_late = then_m < length_m * then_s / age_s - 2.0 * PAIR_NOISE_M
                if is_late or abs(left_m) > arc_m + 2.0 * PAIR_NOISE_M:
                    return False
        back -= max(back // STRIDE, 1)
    return True


@compile_function
def has_set_out(sums, kept, count, back) -> bool:  # type: ignore[no-untyped-def]
    """Whether positions that moved since `back` entries of `count` had moved the same way before, at least half as far
    as who gains their speed at SPEED_CHANGE_MPS2: a leap has its full rate at once, whatever was before it. They had
    where nothing is known of that time. Who goes to and fro faster than that is held to FARTHEST_M alone."""
    then = kept[(count - back) % len(kept)]
    x_m, y_m = sums[POSITION] - then[POSITION], sums[POSITION + 1] - then[POSITION + 1]
    moved_m = max(math.hypot(x_m, y_m), 1e-9)
    speed_mps = moved_m / max(sums[TIME] - then[TIME], 1e-9)
    gaining_s = speed_mps / SPEED_CHANGE_MPS2
    while back < min(count, len(kept)):
        back += 1
        before = kept[(count - back) % len(kept)]
        if then[TIME] - before[TIME] >= gaining_s:
            along_m = x_m * (then[POSITION] - before[POSITION]) + y_m * (then[POSITION + 1] - before[POSITION + 1])
            return bool(along_m / moved_m >= 0.5 * (0.5 * speed_mps * gaining_s) - 2.0 * PAIR_NOISE_M)
    return True


@compile_function
def add_motion_step(step, biases_m, is_on_leg, sums, kept, counts, found) -> None:  # type: ignore[no-untyped-def]
    """Add a step to `sums` (13,), keep them in the ring `kept` (n, 13), and find for each pair of witnesses the
    shortest time over which it differs too much: its place in the ring into `found` (3,), -1 for none.

    `step` (13,) is a time, the displacements by positions, speed and progress, the distance, the slack of a gap, the
    turn (rad), and the speed at its end, which in `sums` is the last one. `counts` (2,) is how many entries the ring
    ever got, and since which of them progress has been known.
    """
    limit_m = compute_limit_m(step[TIME], step[DISTANCE]) + step[SLACK] + FIX_AGE_S * max(step[PACE], sums[PACE])
    sums[PACE] = step[PACE]
    for column in (TIME, DISTANCE, SLACK, TURN):
        sums[column] += step[column]
    is_leap = True
    for column in (POSITION, LEG):  # progress leaps with positions, or not
        is_leap = is_leap and math.hypot(step[column] - step[DRIVEN], step[column + 1] - step[DRIVEN + 1]) > limit_m
        for axis in range(2):
            sums[column + axis] += step[DRIVEN + axis] if is_leap else step[column + axis]
    for axis in range(2):
        sums[DRIVEN + axis] += step[DRIVEN + axis]
        sums[RAW_POSITION + axis] += step[POSITION + axis]
    found[:] = -1
    if not is_on_leg:
        counts[1] = counts[0]
    back = 0
    while back < min(counts[0], len(kept)):
        back += max(back // STRIDE, 1)  # longer times need not be told apart as finely
        if back > min(counts[0], len(kept)):
            break
        place = (counts[0] - back) % len(kept)
        then = kept[place]
        spread_m = MOTION_SHARE * (sums[DISTANCE] - then[DISTANCE]) + sums[SLACK] - then[SLACK]
        pace_mps = max(sums[PACE], then[PACE])
        limit_m = compute_doubt_m(sums[TIME] - then[TIME], 0.0, pace_mps) + spread_m
        for pair in range(PAIR_COUNT):
            if found[pair] >= 0 or (pair > 0 and counts[0] - back < counts[1]):
                continue
            a, b = PAIRS[pair]
            smooth_m = math.hypot(
                sums[a] - sums[b] - then[a] + then[b], sums[a + 1] - sums[b + 1] - then[a + 1] + then[b + 1]
            )
            is_beyond = smooth_m > limit_m + biases_m[pair] and is_growing(sums, kept, counts[0], back, a, b)
            if is_beyond and (pair > 0 or has_set_out(sums, kept, counts[0], back)):
                found[pair] = place
        raw_m = math.hypot(
            sums[RAW_POSITION] - sums[DRIVEN] - then[RAW_POSITION] + then[DRIVEN],
            sums[RAW_POSITION + 1] - sums[DRIVEN + 1] - then[RAW_POSITION + 1] + then[DRIVEN + 1],
        )
        if found[0] < 0 and raw_m > FARTHEST_M + spread_m + FIX_AGE_S * pace_mps:
            found[0] = place
    if counts[0] == 0 or sums[TIME] - kept[(counts[0] - 1) % len(kept), TIME] >= KEPT_S - 1e-6:
        kept[counts[0] % len(kept)] = sums
        counts[0] += 1


@compile_function
def measure_motion_step(before, after, antenna_forward_m, step) -> None:  # type: ignore[no-untyped-def]
    """Measure the displacement of the middle of the rear axle, which moves along the heading, into `step` (13,).

    `before` and `after` (8,) are a time, the pose of the guided point, velocity, and the pose of the progress, NaN for
    none.
    """
    step[TIME] = max(after[0] - before[0], 0.0)
    step_m = 0.5 * (before[4] + after[4]) * step[TIME]
    turned_rad = (after[3] - before[3] + math.pi) % (2.0 * math.pi) - math.pi
    heading_rad = before[3] + 0.5 * turned_rad
    step[DRIVEN], step[DRIVEN + 1] = step_m * math.cos(heading_rad), step_m * math.sin(heading_rad)
    step[DISTANCE], step[TURN], step[PACE] = abs(step_m), turned_rad, abs(after[4])
    # between the mean of two speeds and what a tractor that sped up and braked, or the reverse, drove in between
    step[SLACK] = 0.25 * SPEED_CHANGE_MPS2 * step[TIME] ** 2 if step[TIME] > LONGEST_STEP_S + 1e-6 else 0.0
    step[LEG], step[LEG + 1] = step[DRIVEN], step[DRIVEN + 1]
    for column, pose in ((POSITION, 1), (LEG, 5)):
        if not math.isnan(before[pose] + after[pose]):
            ahead, past = after[pose + 2], before[pose + 2]
            step[column] = after[pose] - before[pose] - antenna_forward_m * (math.cos(ahead) - math.cos(past))
            step[column + 1] = (
                after[pose + 1] - before[pose + 1] - antenna_forward_m * (math.sin(ahead) - math.sin(past))
            )


@compile_function
def follow_report(  # type: ignore[no-untyped-def]
    time_s, x_m, y_m, heading_rad, velocity_mps, leg_pose, is_guided, antenna_forward_m, biases_m, reports, step, sums,
    kept, kept_reports, counts, found,
) -> bool:  # fmt: skip
    """Whether a report contradicts those before it.

    It follows the last two `reports` (2, 8), and the step to it is measured into `step` and added as in
    `add_motion_step`; `kept_reports` (n, 8) are those at the sums that are kept. For its progress also one is found
    that is too far beside its leg though it `is_guided` along that.
    """
    before, after, count = reports[0], reports[1], counts[0]
    before[:] = after
    after[0], after[1], after[2], after[3], after[4] = time_s, x_m, y_m, heading_rad, velocity_mps
    after[5:] = leg_pose
    if math.isnan(before[0]):
        kept_reports[0], counts[0] = after, 1
        return False
    measure_motion_step(before, after, antenna_forward_m, step)
    is_on_leg = not math.isnan(before[5] + after[5])
    add_motion_step(step, biases_m, is_on_leg, sums, kept, counts, found)
    if counts[0] > count:
        kept_reports[count % len(kept)] = after
    off_leg_m = math.hypot(after[1] - after[5], after[2] - after[6])
    if is_on_leg and is_guided and off_leg_m > biases_m[1] + compute_limit_m(math.inf, 0.0):
        found[1] = (counts[0] - 1) % len(kept)
    return bool(found.max() >= 0)


class CredibleMotion:
    """The motion of one tractor by its reports; `antenna_forward_m` is that of its tractor, `off_leg_m` how far it may
    be beside its leg. Times are of the simulated clock, which is `times` as fast as that of the service."""

    def __init__(self, antenna_forward_m: float, off_leg_m: float, times: float = 1.0) -> None:
        self._antenna_forward_m, self._longest_leap_s = antenna_forward_m, LONGEST_STEP_S * times
        self._biases_m = np.array([0.0, off_leg_m, off_leg_m])
        self._step, self._found = np.zeros(COLUMN_COUNT), np.full(PAIR_COUNT, -1)
        self.restart()

    def restart(self) -> None:
        """Forget all: what is reported next is believed until it contradicts itself."""
        self._sums, self._kept = np.zeros(COLUMN_COUNT), np.zeros((KEPT_COUNT, COLUMN_COUNT))
        self._kept_reports = np.full((KEPT_COUNT, REPORT_SIZE), np.nan)
        self._counts = np.zeros(2, dtype=np.int64)
        self._reports = np.full((2, REPORT_SIZE), np.nan)  # the last two
        self._hidden_s, self._late_s = 0.0, 0.0
        self._dated_s = (math.nan, math.nan)  # the last report, by its own clock and by its arrival
        self.doubt: MotionDoubt | None = None
        self.is_moving_unreported = False

    def add_report(
        self, report: TractorReport, leg_pose: Floats | None, time_s: float, arrived_s: float, delay_s: float = 0.0
    ) -> None:
        """Add a report of a time by the tractor's clock that came at one of the service, `delay_s` after it was made,
        with the pose (3,) of its progress on its leg; None where it follows none."""
        is_contradiction = follow_report(
            self._date_report(time_s, arrived_s, delay_s), report.x_m, report.y_m, report.heading_rad,
            report.velocity_mps, NOWHERE if leg_pose is None else leg_pose, report.mode == AUTOMATIC,
            self._antenna_forward_m, self._biases_m, self._reports, self._step, self._sums, self._kept,
            self._kept_reports, self._counts, self._found,
        )  # fmt: skip
        self.is_moving_unreported = is_contradiction and self._is_moving_unreported()
        if is_contradiction and self.doubt is None:
            ages_s = [self._get_age_s(place) if place >= 0 else math.inf for place in self._found.tolist()]
            self.doubt = self._describe_doubt(int(self._found[int(np.argmin(ages_s))]))

    def _date_report(self, time_s: float, arrived_s: float, delay_s: float) -> float:
        """When a report was made: after the one before by the time of its own clock, where arrivals allow that.

        It may be made up for what earlier reports were late by; what exceeds that is a clock that was set, or lies.
        """
        (last_time_s, last_arrived_s), self._dated_s = self._dated_s, (time_s, arrived_s)
        if math.isnan(last_time_s):
            self._late_s = delay_s
            return 0.0
        seconds, between_s = time_s - last_time_s, arrived_s - last_arrived_s
        if 0.0 <= seconds <= max(between_s + self._late_s, self._longest_leap_s):
            self._late_s = max(self._late_s + between_s - seconds, 0.0)
        else:
            seconds, self._late_s = between_s, 0.0
        return float(self._reports[1, 0]) + seconds

    def measure_speed_mps(self) -> float:
        """The greatest speed that a witness shows now, over the last reports, of those that tractors have."""
        place = max(int(self._counts[0]) - 1 - STRIDE, 0) % KEPT_COUNT
        moved, then, now = self._sums - self._kept[place], self._kept_reports[place], self._reports[1]
        speeds_mps = [abs(float(now[4]))]
        if moved[TIME] >= KEPT_S:
            lengths_m = (
                np.hypot(*moved[DRIVEN : DRIVEN + 2]),
                math.dist(now[1:3], then[1:3]),
                math.dist(now[5:7], then[5:7]),
            )
            speeds_mps += [float(length_m / moved[TIME]) for length_m in lengths_m]
        return max((speed_mps for speed_mps in speeds_mps if speed_mps <= FASTEST_MPS), default=0.0)

    def _is_moving_unreported(self) -> bool:
        """Whether it moves more than it says."""
        age_s = math.inf
        for place, witness in ((int(self._found[0]), POSITIONS), (int(self._found[2]), PROGRESS)):
            if place >= 0:
                moved_m = self._measure_displacements_m(place)
                if np.hypot(*moved_m[witness]) > np.hypot(*moved_m[SPEED]):
                    age_s = min(age_s, self._get_age_s(place))
        if not self.is_moving_unreported and math.isfinite(age_s):
            self._hidden_s = age_s
        return age_s <= STILL_SHARE * self._hidden_s

    def _get_age_s(self, place: int) -> float:
        return float(self._sums[TIME] - self._kept[place, TIME])

    def _describe_doubt(self, place: int) -> MotionDoubt:
        """The doubt by what the witnesses show since an entry of the ring.

        The suspect is farthest from the others; of two alone it is the one that claims less motion.
        """
        age_s, moved_m = self._get_age_s(place), self._measure_displacements_m(place)
        latest = int(self._counts[0]) - 1
        if latest - (latest - place) % KEPT_COUNT < self._counts[1]:
            del moved_m[PROGRESS]
        lengths_m = {name: float(np.hypot(*moved)) for name, moved in moved_m.items()}
        apart_m = {
            name: round(float(sum(np.hypot(*(moved - other)) for other in moved_m.values())), 6)
            for name, moved in moved_m.items()
        }
        suspect = max(moved_m, key=lambda name: (apart_m[name], -lengths_m[name]))
        _, x, y, heading_rad, velocity_mps = self._kept_reports[place, :5].tolist()
        driven_m = [length_m for name, length_m in lengths_m.items() if name != POSITIONS]
        driven_m.append(math.dist((x, y), self._reports[1, 1:3]))
        shown_mps = (length_m / max(age_s, KEPT_S) for length_m in driven_m)
        speed_mps = max([abs(velocity_mps), *(speed for speed in shown_mps if speed <= FASTEST_MPS)])
        return MotionDoubt(suspect, age_s, lengths_m, (x, y, heading_rad), speed_mps)

    def _measure_displacements_m(self, place: int) -> dict[str, Floats]:
        """How far each witness moved since an entry of the ring (2,), leaps included."""
        moved = self._sums - self._kept[place]
        columns = {POSITIONS: RAW_POSITION, SPEED: DRIVEN, PROGRESS: LEG}
        return {name: moved[column : column + 2] for name, column in columns.items()}
