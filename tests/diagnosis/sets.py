"""Sets of logs by the second reference: what is hidden in each, drawn from a seed, and what a diagnosis made of it.

A seed has 80 sets: each effect of the catalogue alone at a clear size, at half and at a third of it; pairs of effects
from every two of the four blocks; triples from every three; and sets with nothing hidden. Tractors take turns from set
to set and from seed to seed, so that two seeds in a row show every set on both. Drives of every other pair of seeds are
mirrored. Sizes are drawn up to a quarter above the share of the clear size, signs and places wherever there are any.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement
from zlib import crc32

import numpy as np

from tests.truth.drives import three_speeds_programme
from tests.truth.effects import CLEAR_SIZES, NEUTRAL, PLACES, scaled
from tests.truth.second import TRACTORS, second_logs
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.results import Diagnosis
from vehicle.identification.logs.reader import build_log
from vehicle.model.tractor import load_tractor

SIZES = {"clear": 1.0, "half": 0.5, "third": 1.0 / 3.0}
BLOCKS = {
    "command to wheel": ("steering_dead_time", "steering_lag", "steering_rate", "steering_deadband"),
    "wheel to path": (
        "steering_offset", "steering_gain", "steering_asymmetry", "steering_backlash", "side_slip", "understeer",
        "cross_slope_drift", "implement_side_draft", "grip_patch", "grip_drift",
    ),
    "speed": ("wheel_slip", "implement_slip", "speed_lag"),
    "position": ("antenna_forward", "antenna_right", "gnss_latency", "heading_bias"),
}  # fmt: skip
EITHER_WAY = ("steering_offset", "steering_gain", "steering_asymmetry", "implement_side_draft", "antenna_forward",
              "antenna_right", "heading_bias", "grip_drift")  # fmt: skip
MOST_ABOVE, SPREAD_M, EMPTY_SETS = 1.25, 6.0, 3


@dataclass(frozen=True)
class LogSet:
    """One set: its seed, the names of what is hidden, at which of SIZES, in which tractor."""

    seed: int
    names: tuple[str, ...]
    size: str
    tractor: str
    number: int = 0

    @property
    def key(self) -> str:
        """What tells this set from all others."""
        what = "+".join(self.names) or f"nothing {self.number}"
        return f"{what} {self.size} {self.tractor} {self.seed}"

    def effects(self) -> dict[str, dict[str, float]]:
        """The hidden effects with their values."""
        rng = np.random.default_rng([self.seed, crc32(self.key.encode())])
        return {name: drawn(name, SIZES[self.size] * float(rng.uniform(1.0, MOST_ABOVE)), rng) for name in self.names}


def drawn(name: str, share: float, rng: np.random.Generator) -> dict[str, float]:
    """An effect at a share of its clear size, to either side where it has two, somewhere in the field."""
    values = scaled(name, share)
    if name in EITHER_WAY and rng.random() < 0.5:
        values = {key: 2.0 * NEUTRAL[name][key] - value for key, value in values.items()}
    for key in values:
        if key == "bearing_deg":
            values[key] = float(rng.uniform(0.0, 360.0))
        elif key in ("east_m", "north_m"):
            values[key] += float(rng.uniform(-SPREAD_M, SPREAD_M))
    return values


def sets_of(seed: int) -> list[LogSet]:
    """All sets of a seed, shuffled, so that the first of them are a fair sample of all."""
    rng = np.random.default_rng([seed, 21])
    what: list[tuple[tuple[str, ...], str]] = [((name,), size) for size in SIZES for name in CLEAR_SIZES]
    for count, choose in ((2, combinations_with_replacement), (3, combinations)):
        for blocks in choose(BLOCKS, count):
            what.append((_one_of_each(blocks, rng), "clear"))
    what += [((), "clear")] * EMPTY_SETS
    tractors = list(TRACTORS)
    sets = [LogSet(seed, names, size, tractors[(place + seed) % len(tractors)], place)
            for place, (names, size) in enumerate(what)]  # fmt: skip
    return [sets[place] for place in rng.permutation(len(sets))]


def _one_of_each(blocks: tuple[str, ...], rng: np.random.Generator) -> tuple[str, ...]:
    """An effect of each block, never one twice."""
    while True:
        names = tuple(str(rng.choice(BLOCKS[block])) for block in blocks)
        if len(set(names)) == len(names):
            return names


def diagnosed_set(one: LogSet) -> Diagnosis:
    """The diagnosis of a set, with the file of the tractor that drove it."""
    runs = [run.mirrored() if one.seed // 2 % 2 else run for run in three_speeds_programme()]
    frames = second_logs(one.effects(), one.seed, runs, one.tractor)
    logs = [build_log(frame, frame.attrs["name"]) for frame in frames]
    return diagnose_logs(logs, load_tractor(one.tractor), "soil")


def record_of(one: LogSet) -> dict[str, object]:
    """What was hidden and what was said, as JSON has it; with `error` in the place of an answer that never came."""
    head = {"key": one.key, "seed": one.seed, "size": one.size, "tractor": one.tractor, "hidden": one.effects()}
    begun = time.process_time()
    try:
        found = diagnosed_set(one)
    except Exception as error:  # a set that breaks the diagnosis is a result, and must not end a run of hours
        return head | {"error": f"{type(error).__name__}: {error}"}
    said = [
        {"id": finding.id, "status": finding.status, "value": finding.value, "interval": finding.interval,
         "visible": finding.smallest_visible}
        for finding in found.findings
    ]  # fmt: skip
    return head | {"named": found.named, "said": said, "unexplained": found.unexplained_share,
                   "cpu_s": round(time.process_time() - begun, 2)}  # fmt: skip


def size_of(values: dict[str, float]) -> str:
    """The parameter that says how large an effect is, not where."""
    return next(key for key in values if key not in PLACES)


def inside(interval: dict[str, list[float]] | None, truth: dict[str, float]) -> bool | None:
    """Whether the size hidden is in the interval said; None without one."""
    key = size_of(truth)
    if not interval or key not in interval:
        return None
    low, high = interval[key]
    return bool(math.isfinite(truth[key]) and low <= truth[key] <= high)
