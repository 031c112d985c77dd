"""When a twin is wrong: a sequential test of its innovations against the effects of the catalogue.

While the monitor (vehicle.twin.kalman_filter) is right, its whitened innovations are independent standard normal
numbers. An effect would give them means, which the filter predicts, so each effect, sign and size has a likelihood
ratio per fix with expectation 1. The Shiryaev-Roberts sums of these ratios, R <- (R + seconds since the last fix) *
ratio, grow by at most one a second on average, as does their mean over all effects. So it exceeds a limit of A seconds
at most once in A seconds on average, whatever the steering does (optional stopping; Shin, Ramdas and Rinaldo,
"E-detectors", 2024). One more ratio is for innovations that are only too large, from whatever cause.

Positions may also jump, by a reflection or another solution of the receiver, which is no evidence against the tractor.
Every hypothesis therefore includes a few jumps, so that a single fix is little evidence: an effect that explains it no
better than a jump has the ratio 1. As a jump may look like an effect by chance, the limit has to be exceeded for
MIN_FIXES_IN_A_ROW fixes. An effect shows at every fix, while a jump is over at once or goes back; so an innovation too
large for noise is reported as a jump only if the next fix agrees with it or is back where it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats
from fields.units import HOUR_S
from vehicle.jit import compile_function
from vehicle.model.effects import get_effect
from vehicle.model.tractor import Tractor
from vehicle.twin.kalman_filter import MEASUREMENT_SIZE, SHIFT_COUNT, STATE_SIZE

JUMP_PROBABILITY = 1e-4  # of a fix: once in 2.8 hours at 1 Hz
JUMP_SPREAD_SIGMAS = 50.0  # spread of jumps, in standard deviations of a fix
RESTART_SIGMA_M = 100.0  # uncertainty of the place before the first fix after a jump
MAX_RETURN_SHARE = 0.5  # of a jump: largest remaining distance after one that goes back
MAX_JUMPS = 1000
_FLAT_LOG_DENSITY = math.log(JUMP_PROBABILITY) - 2.0 * math.log(JUMP_SPREAD_SIGMAS)
FALSE_ALARM_S = 200.0 * HOUR_S  # mean driving time between false alarms, at least, if the noise is as given
SIZE_FACTORS = np.array([-2.0, -0.7, 0.7, 2.0])  # of the typical size: both signs, small and large
WIDENING_FACTOR = 1.5  # of innovations that are only too large
MIN_FIXES_IN_A_ROW = 3
# The effect of each shift of vehicle.twin.kalman_filter, in the order of its columns there.
SHIFT_EFFECTS = (
    "steering_offset", "steering_gain", "steering_asymmetry", "steering_dead_time", "wheel_slip",
    "cross_slope_drift", "cross_slope_drift", "implement_side_draft", "implement_slip",
    "heading_bias", "antenna_forward", "antenna_right", "gnss_latency",
)  # fmt: skip


@dataclass(frozen=True)
class PositionJump:
    """At `time_s` the fix jumped by so many metres ahead and to the right."""

    time_s: float
    ahead_m: float
    right_m: float

    @property
    def distance_m(self) -> float:
        """Length of the jump."""
        return math.hypot(self.ahead_m, self.right_m)


@compile_function
def compute_log_density(east: float, north: float, turned: float, size: float) -> float:
    """Log density, up to a constant, of innovations in place and heading, with noise `size` times as large: either all
    is noise, or the place has jumped."""
    place, heading = 0.5 * (east * east + north * north), 0.5 * turned * turned
    square = size * size
    noise = math.log(1.0 - JUMP_PROBABILITY) - (place + heading) / square - 3.0 * math.log(size)
    leap = _FLAT_LOG_DENSITY - place / (JUMP_SPREAD_SIGMAS * JUMP_SPREAD_SIGMAS) - heading / square - math.log(size)
    high, low = max(noise, leap), min(noise, leap)
    return high + math.log1p(math.exp(low - high))


@compile_function
def compute_noise_probability(east: float, north: float) -> float:
    """The probability that innovations in place are noise and not a jump."""
    place = 0.5 * (east * east + north * north)
    apart = (
        _FLAT_LOG_DENSITY - place / (JUMP_SPREAD_SIGMAS * JUMP_SPREAD_SIGMAS) - math.log(1.0 - JUMP_PROBABILITY) + place
    )
    return 0.0 if apart > 700.0 else 1.0 / (1.0 + math.exp(apart))


def is_jump(whitened: Floats) -> bool:
    """Whether innovations (4,) in east, north, heading and speed are a jump rather than noise."""
    return bool(compute_noise_probability(float(whitened[0]), float(whitened[1])) < 0.5)


class JumpDetector:
    """The jumps of the fix so far, and a candidate that the next fix decides."""

    def __init__(self) -> None:
        self.jumps: list[PositionJump] = []
        self._candidate: PositionJump | None = None
        self._in_a_row = 0

    def add_fix(self, time_s: float, offset: Floats, is_sudden: bool) -> tuple[bool, bool]:
        """Add a fix that is `offset` (3,) from the prediction, ahead and right (m); returns whether the fix before is
        now known to have been a jump, and whether this one may be a jump or goes back."""
        jump = PositionJump(time_s, float(offset[0]), float(offset[1]))
        first, is_alone = self._candidate, self._in_a_row == 1
        self._candidate, self._in_a_row = (jump, self._in_a_row + 1) if is_sudden else (None, 0)
        if first is None or not is_alone:
            return False, self._in_a_row == 1
        remaining_m = float(np.hypot(first.ahead_m + jump.ahead_m, first.right_m + jump.right_m))
        if is_sudden and remaining_m > MAX_RETURN_SHARE * first.distance_m:
            return False, False
        self._append_jump(first)
        self._candidate, self._in_a_row = None, 0  # going back is not another jump
        return True, is_sudden

    def add_outlier(self, time_s: float, offset: Floats) -> None:
        """Add the first of several outliers, which are ignored unless there are several in a row."""
        self._append_jump(PositionJump(time_s, float(offset[0]), float(offset[1])))
        self._candidate, self._in_a_row = None, 0

    def _append_jump(self, jump: PositionJump) -> None:
        self.jumps.append(jump)
        del self.jumps[:-MAX_JUMPS]


@dataclass(frozen=True)
class ModelMismatch:
    """The twin's corrections exceed what noise explains.

    `since_s` is the estimated begin, `detected_s` the time of detection; `evidence_s`: noise alone would give as much
    evidence once in so many seconds of driving (at most 1e300). `effect_id` is the effect that predicts the innovations
    best, with `amount` in the catalogue's unit, "" for none: a hint, which the diagnosis of the recorded log confirms
    or not. `innovation_ratio` is the size of the innovations, 1 for noise alone.
    """

    since_s: float
    detected_s: float
    evidence_s: float
    innovation_ratio: float
    effect_id: str
    amount: float
    words: str


@compile_function
def accumulate_evidence(  # type: ignore[no-untyped-def]
    whitened, means, factors, waited_s, time, widening, logs, best, since, fits
) -> None:
    """Add one fix to `logs` (k + 1, f) of the sums, `best` (their logs since `since`) and `fits` (k, 2) of the sizes.

    The last row of `logs`, `best` and `since` is for innovations that are only too large, and uses its first column.
    """
    kinds = means.shape[1]
    east, north, turned = whitened[0], whitened[1], whitened[2]
    expected = compute_log_density(east, north, turned, 1.0)
    for k in range(kinds + 1):
        share = 0.0
        for j in range(len(factors) if k < kinds else 1):
            if k < kinds:
                left_east, left_north = east - factors[j] * means[0, k], north - factors[j] * means[1, k]
                ratio = compute_log_density(left_east, left_north, turned - factors[j] * means[2, k], 1.0) - expected
                share = max(share, compute_noise_probability(left_east, left_north))
            else:
                ratio = compute_log_density(east, north, turned, widening) - expected
            low, high = math.log(waited_s), logs[k, j]
            if low > high:
                low, high = high, low
            logs[k, j] = high + math.log1p(math.exp(low - high)) + ratio
            if best[k, j] <= 0.0:
                best[k, j], since[k, j] = 0.0, time
            best[k, j] += ratio
        if k < kinds:
            for i in range(3):
                fits[k, 0] += share * means[i, k] * whitened[i]
                fits[k, 1] += share * means[i, k] * means[i, k]


class MismatchTest:
    """The evidence of one twin, from a time on."""

    def __init__(self, tractor: Tractor, time_s: float) -> None:
        # In SI: wheel angles are converted to curvatures, and right (clockwise) becomes negative.
        sizes = np.array([get_effect(name).size.typical for name in SHIFT_EFFECTS])
        sizes[0] = -math.tan(math.radians(sizes[0])) / tractor.wheelbase_m
        sizes[7] = -sizes[7]
        sizes[9] = -math.radians(sizes[9])
        self.sizes = sizes
        self.shifts = np.zeros((SHIFT_COUNT, STATE_SIZE))
        self.whitened, self.means = np.zeros(MEASUREMENT_SIZE), np.zeros((MEASUREMENT_SIZE, SHIFT_COUNT))
        self.reset(time_s)

    def reset(self, time_s: float) -> None:
        """Forget all evidence."""
        shape = (SHIFT_COUNT + 1, len(SIZE_FACTORS))
        self.shifts[:] = 0.0
        self.logs, self.best = np.full(shape, -math.inf), np.zeros(shape)
        self.since, self.fits = np.full(shape, time_s), np.zeros((SHIFT_COUNT, 2))
        self.time_s, self.detected_s = time_s, math.nan
        self.squares, self._last_square, self._passed_in_a_row = [0.0, 0], 0.0, 0

    @property
    def evidence_s(self) -> float:
        """The mean of the sums: noise alone brings it to A at most once in A seconds."""
        sums = np.append(self.logs[:-1].ravel(), self.logs[-1, 0])
        top = float(sums.max())
        if top == -math.inf:
            return 0.0
        return math.exp(min(top + math.log(float(np.mean(np.exp(sums - top)))), 690.0))

    def add_fix(self, time_s: float, has_jumped: bool = False) -> None:
        """Add the innovations in `whitened` and `means` of a fix. `has_jumped` means that the fix before was a jump."""
        waited, sums = max(time_s - self.time_s, 1e-3), (self.logs, self.best, self.since, self.fits)
        accumulate_evidence(self.whitened, self.means, SIZE_FACTORS, waited, time_s, WIDENING_FACTOR, *sums)
        self.time_s = time_s
        if has_jumped:
            self.squares[0] -= self._last_square
            self.squares[1] -= 3
        self._last_square = float(self.whitened[:3] @ self.whitened[:3])
        self.squares[0] += self._last_square
        self.squares[1] += 3
        self._passed_in_a_row = self._passed_in_a_row + 1 if self.evidence_s > FALSE_ALARM_S else 0
        if math.isnan(self.detected_s) and self._passed_in_a_row >= MIN_FIXES_IN_A_ROW:
            self.detected_s = time_s

    def find_mismatch(self) -> ModelMismatch | None:
        """The mismatch, once the evidence has been sufficient; else None."""
        if math.isnan(self.detected_s):
            return None
        kind, column = np.unravel_index(int(np.argmax(self.logs)), self.logs.shape)
        times = math.sqrt(self.squares[0] / max(self.squares[1], 1))
        name, amount = "", 0.0
        sentence = "The corrections exceed what noise explains"
        if kind == SHIFT_COUNT:
            sentence += ", and no simple effect predicts them."
        else:
            name, share = SHIFT_EFFECTS[kind], self.fits[kind, 0] / max(self.fits[kind, 1], 1e-12)
            effect = get_effect(name)
            amount = float(share) * effect.size.typical + (effect.size.neutral or 0.0)
            unit = f" {effect.size.unit}" if effect.size.unit else ""
            sentence += f"; they look most like {effect.label} (about {amount:.2g}{unit})."
        since = float(self.since[kind, column])
        return ModelMismatch(since, self.detected_s, self.evidence_s, times, name, amount, sentence)
