"""When a twin is wrong: a sequential test of its surprises against every effect the catalogue would show.

While the witness (vehicle.twin.belief) is right, its whitened surprises are independent standard normal numbers. An
effect would give them means that the filter foretells, so each effect, way and size has a likelihood ratio per fix
whose expectation is 1. Their Shiryaev-Roberts sums, R <- (R + seconds waited) * ratio, grow by one a second on average
and no more, and so does their mean over all effects: it passes a limit of A seconds no oftener than once in A seconds
on average (optional stopping; Shin, Ramdas and Rinaldo, "E-detectors", 2024), whatever the steering does. One further
ratio is for surprises that are only larger than they should be, whatever the cause.

Either hypothesis has it that a few fixes leap (vehicle.twin.leaps), and so no single one is much evidence: what an
effect explains no better than a leap does has the ratio 1. Where no fix ever leaps, the expectation of a ratio is below
1. As one leap may look like an effect by chance, the limit has to be passed for SURE fixes in a row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vehicle.effects import effect
from vehicle.jit import compiled
from vehicle.tractor import Tractor
from vehicle.twin.belief import SEEN, SHIFTS, SIZE
from vehicle.twin.leaps import log_density, noise_share
from vehicle.twin.motion import Array

FALSE_ALARM_S = 200.0 * 3600.0  # at most one false alarm in so long a drive on average, if noise is as it is said to be
FACTORS = np.array([-2.0, -0.7, 0.7, 2.0])  # of the typical size: both ways, small and large
WIDER = 1.5  # of surprises without a direction
SURE = 3  # fixes
# The effect each shift of belief stands for, in the order of its columns there.
EFFECTS = (
    "steering_offset", "steering_gain", "steering_asymmetry", "steering_dead_time", "wheel_slip", "cross_slope_drift",
    "cross_slope_drift", "implement_side_draft", "implement_slip", "heading_bias", "antenna_forward", "antenna_right",
    "gnss_latency",
)  # fmt: skip
NEITHER = "none of the catalogue's simple ones"


def shift_sizes(tractor: Tractor) -> Array:
    """Typical size (13,) of what each effect shifts, in SI, for a tractor.

    An angle of the wheels is a curvature; right is clockwise, and a left draft or offset counter-clockwise.
    """
    sizes = np.array([effect(name).size.typical for name in EFFECTS])
    sizes[0] = -math.tan(math.radians(sizes[0])) / tractor.wheelbase_m
    sizes[7] = -sizes[7]
    sizes[9] = -math.radians(sizes[9])
    return sizes


@dataclass(frozen=True)
class Doubt:
    """The twin's corrections exceed what noise explains.

    `since_s` is when that began as far as can be told, `told_s` when it was sure; `seconds` the evidence: noise alone
    would say as much once in so many seconds of driving (at most 1e300). `like` is the effect that foretells the
    surprises best, by `amount` in the catalogue's unit, "" for none: a hint, which the diagnosis of the recorded log
    confirms or not. `times` is how large the surprises are since then, 1 for noise alone.
    """

    since_s: float
    told_s: float
    seconds: float
    times: float
    like: str
    amount: float
    words: str


@compiled
def gather(  # type: ignore[no-untyped-def]
    whitened, means, factors, waited, time, wider, logs, best, since, fits
) -> None:  # fmt: skip
    """One fix more: `logs` (k + 1, f) of the sums, `best` their logs since `since`, `fits` (k, 2) for the sizes.

    The last row of `logs`, `best` and `since` uses its first column: surprises that are only larger.
    """
    kinds = means.shape[1]
    east, north, turned = whitened[0], whitened[1], whitened[2]
    expected = log_density(east, north, turned, 1.0)
    for k in range(kinds + 1):
        share = 0.0
        for j in range(len(factors) if k < kinds else 1):
            if k < kinds:
                left_east, left_north = east - factors[j] * means[0, k], north - factors[j] * means[1, k]
                ratio = log_density(left_east, left_north, turned - factors[j] * means[2, k], 1.0) - expected
                share = max(share, noise_share(left_east, left_north))
            else:
                ratio = log_density(east, north, turned, wider) - expected
            low, high = math.log(waited), logs[k, j]
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


class Test:
    """The sums of one twin, from a time on."""

    def __init__(self, tractor: Tractor, time_s: float) -> None:
        self.sizes = shift_sizes(tractor)
        self.shifts = np.zeros((SHIFTS, SIZE))
        self.whitened, self.means = np.zeros(SEEN), np.zeros((SEEN, SHIFTS))
        self.restart(time_s)

    def restart(self, time_s: float) -> None:
        """Forget all evidence."""
        shape = (SHIFTS + 1, len(FACTORS))
        self.shifts[:] = 0.0
        self.logs, self.best = np.full(shape, -math.inf), np.zeros(shape)
        self.since, self.fits = np.full(shape, time_s), np.zeros((SHIFTS, 2))
        self.time_s, self.told_s = time_s, math.nan
        self.squares, self._last_square, self._passed = [0.0, 0], 0.0, 0

    @property
    def seconds(self) -> float:
        """The mean of the sums: noise alone brings it to A once in A seconds or more rarely."""
        sums = np.append(self.logs[:-1].ravel(), self.logs[-1, 0])
        top = float(sums.max())
        if top == -math.inf:
            return 0.0
        return math.exp(min(top + math.log(float(np.mean(np.exp(sums - top)))), 690.0))

    def take(self, time_s: float, leapt: bool = False) -> None:
        """Count the surprises in `whitened` and `means`, of a fix at a time; by it the one before may be known to have
        `leapt`."""
        waited = max(time_s - self.time_s, 1e-3)
        gather(
            self.whitened, self.means, FACTORS, waited, time_s, WIDER, self.logs, self.best, self.since, self.fits
        )  # fmt: skip
        self.time_s = time_s
        if leapt:
            self.squares[0] -= self._last_square
            self.squares[1] -= 3
        self._last_square = float(self.whitened[:3] @ self.whitened[:3])
        self.squares[0] += self._last_square
        self.squares[1] += 3
        self._passed = self._passed + 1 if self.seconds > FALSE_ALARM_S else 0
        if math.isnan(self.told_s) and self._passed >= SURE:
            self.told_s = time_s

    def doubt(self) -> Doubt | None:
        """What the evidence says, once it has been enough."""
        if math.isnan(self.told_s):
            return None
        kind, column = np.unravel_index(int(np.argmax(self.logs)), self.logs.shape)
        times = math.sqrt(self.squares[0] / max(self.squares[1], 1))
        since = float(self.since[kind, column])
        if kind == SHIFTS:
            return Doubt(since, self.told_s, self.seconds, times, "", 0.0, _words("", 0.0))
        share = self.fits[kind, 0] / max(self.fits[kind, 1], 1e-12)
        name = EFFECTS[kind]
        size = effect(name).size
        amount = float(share) * size.typical + (size.neutral or 0.0)
        return Doubt(since, self.told_s, self.seconds, times, name, amount, _words(name, amount))


def _words(name: str, amount: float) -> str:
    sentence = "The corrections exceed what noise explains"
    if not name:
        return f"{sentence}, and no simple effect foretells them."
    one = effect(name)
    unit = f" {one.size.unit}" if one.size.unit else ""
    return f"{sentence}; they look most like {one.label} (about {amount:.2g}{unit})."
