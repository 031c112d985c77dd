"""What a diagnosis says: one status per effect, errors before and after, what is left, and the next drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Stretch
from vehicle.measured.replay.horizons import Error
from vehicle.tractor import Tractor

NAMED, LIKELY, EQUIVALENT, REFUTED, NOT_VISIBLE = "named", "likely", "equivalent", "refuted", "not-visible"
Errors = dict[float, Error]


@dataclass(frozen=True)
class Finding:
    """One effect of the catalogue.

    `value` and `interval` (95 %) are None unless the effect is in the model: what is `likely` is clearly not neutral
    and helps runs held out, without being shown to be the cause. What is `refuted` is so from `smallest_visible` on,
    a limit up to there. `gain_pct` is the reduction of the error over 5 s on runs not used for fitting (of the path at
    the speed that was measured), `gain_interval` its 90 % interval over runs; `smallest_visible` the smallest size
    these logs would have shown (None when no size would). `exchange` says how much of another effect looks alike.
    """

    id: str
    status: str
    value: dict[str, float] | None
    interval: dict[str, tuple[float, float]] | None
    gain_pct: float | None
    gain_interval: tuple[float, float] | None
    smallest_visible: float | None
    unit: str
    block: str
    words: str
    equivalent_to: tuple[str, ...] = ()
    exchange: str = ""


@dataclass(frozen=True)
class Grounds:
    """An effect that differs between runs made on two grounds: its value, in words, and the runs that have it."""

    id: str
    value: dict[str, float]
    words: str
    runs: tuple[str, ...]


@dataclass(frozen=True)
class NextDrive:
    """The cheapest drive that tells rival causes apart: what to drive, for how long, and how clearly it decides.

    Without `decides` it is the most telling drive of those known, but may not be enough.
    """

    id: str
    words: str
    seconds: float
    separates: tuple[str, str]
    score: float
    decides: bool = True


@dataclass(frozen=True, eq=False)
class ResidualPlot:
    """What is left against what it depends on: middles, means and standard errors of bins, before and after."""

    regressor: str
    quantity: str
    at: Array
    before: Array
    before_error: Array
    after: Array
    after_error: Array


@dataclass(frozen=True)
class Left:
    """What is left above the noise over the longest pieces of `over_s` s, each told as it would be in a plan.

    `late_s` is the way along, driven at the usual speed; `aside_cm` the way across, where nobody steers back.
    """

    over_s: float
    late_s: float
    aside_cm: float


@dataclass(frozen=True)
class PlanGain:
    """A small plan driven by the tractor of the file and by the extended one: time, and lateral error on the tracks.

    `left_s` and `left_cm` are what the rest, which names no cause, changes of them; None without one.
    """

    field: str
    time_before_s: float | None
    time_after_s: float | None
    lateral_before_cm: float
    lateral_after_cm: float
    left_s: float | None = None
    left_cm: float | None = None


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The whole answer; see the contract of `headland diagnose --json`.

    `along_judged` is False where a log lacks a measured speed: errors along the way then say nothing of the tractor.
    `above_noise_s` are the horizons over which what all effects leave is more than noise; the share is of those of 5 s.
    """

    names: tuple[str, ...]
    rows_used: int
    rows_gated: int
    minutes: float
    ground: str
    before: Errors
    after: Errors
    floor: Errors
    guilty_block: str | None
    block_error: dict[str, tuple[float, float]]
    findings: tuple[Finding, ...]
    named: tuple[str, ...]
    unexplained_share: float
    depends_on: tuple[str, ...]
    next_drive: NextDrive | None
    tractor: Tractor
    calibration: dict[str, dict[str, float]]
    curve: ResidualPlot | None
    notes: tuple[str, ...] = ()
    plan: PlanGain | None = None
    grounds: tuple[Grounds, ...] = ()
    pace_mps: float = 0.0
    along_judged: bool = True
    above_noise_s: tuple[float, ...] = ()

    @property
    def as_good_as_noise(self) -> bool:
        """Whether what all effects together leave is what noise would leave, over every horizon."""
        return self.unexplained_share == 0.0 and not self.above_noise_s

    @property
    def left(self) -> Left | None:
        """What is left above the noise; None without errors or where nobody drove."""
        if not self.after or self.pace_mps <= 0.0:
            return None
        over = max(self.after)
        along, across = (
            math.sqrt(max(getattr(self.after[over], kind) ** 2 - getattr(self.floor[over], kind) ** 2, 0.0))
            for kind in ("along_cm", "cross_cm")
        )
        return Left(over, along / 100.0 / self.pace_mps, across)

    @property
    def headline(self) -> str:
        """The verdict in a sentence or two."""
        by_id = {one.id: one for one in self.findings}
        if self.named:
            return " ".join(by_id[name].words for name in self.named)
        sets = [one for one in self.findings if one.status == EQUIVALENT]
        if sets:
            return "Several causes fit these logs equally well: " + " Or: ".join(one.words for one in sets)
        likely = [one for one in self.findings if one.status == LIKELY]
        if likely:
            return "No cause is certain. Likely: " + " ".join(one.words for one in likely)
        if self.depends_on:
            return f"No known cause explains these logs: what the simulation gets wrong is {listed(self.depends_on)}."
        if self.unexplained_share > 0.0:
            return "No known cause explains these logs, and what is wrong depends on nothing that was looked for."
        if self.calibration or self.tractor.rest is not None:
            return "No cause found; the rest that was fitted lowers the error and has no name."
        if any("already" in note for note in self.notes):
            return "Nothing found beyond what the tractor file said already, or against it: see the notes."
        return "Nothing found: the tractor drives as its file says, as far as these logs can show."


def listed(parts: Sequence[str]) -> str:
    """Clauses as one: a; b; and c."""
    if len(parts) < 3:
        return " and ".join(parts)
    return "; ".join(parts[:-1]) + "; and " + parts[-1]


def finite(value: float) -> float | None:
    """A number for JSON, None for one that JSON cannot hold."""
    return float(value) if np.isfinite(value) else None


@dataclass(frozen=True, eq=False)
class ReplayedStretch:
    """One stretch: the measured rows, the simulated antenna laid on the first seconds, wheel angle and speed.

    `pieces` holds, per piece of 5 s, its rows and the errors after anchoring (cross, along in m; heading in rad).
    """

    measured: Stretch
    antenna: Array
    wheel: Array
    speed: Array
    pieces: tuple[tuple[slice, Array], ...]


@dataclass(frozen=True, eq=False)
class Replayed:
    """A replayed run and its errors by horizon."""

    name: str
    tractor: str
    effects: tuple[str, ...]
    errors: Errors
    stretches: tuple[ReplayedStretch, ...]
    rows_gated: int
