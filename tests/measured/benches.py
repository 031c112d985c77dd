"""Benches for tests: noise-free drives of the simulator itself, and a stand-in whose surprises are linear."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from vehicle.effects import effect
from vehicle.layout import DT_S
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.knobs import Knobs, knobs_for
from vehicle.measured.replay.drives import DRILLS, driven
from vehicle.measured.replay.horizons import chain
from vehicle.measured.replay.replaying import Rig, make_rig, replay
from vehicle.measured.replay.states import FORWARD
from vehicle.measured.surprise.bench import Bench, Change, prepare
from vehicle.measured.surprise.whitening import Noise
from vehicle.tractor import Tractor, load_tractor

Settings = Mapping[str, Mapping[str, float]]
# Position, its drift, heading, its drift, soil and way of an ordinary receiver on an ordinary field.
NOISE = Noise(0.010, 0.015, 0.002, 0.0017, 0.0025, 0.006)


@lru_cache(maxsize=1)
def eg105() -> Tractor:
    return load_tractor("eg105")


@lru_cache(maxsize=1)
def rig() -> Rig:
    return make_rig(eg105(), "soil", (0.0, 0.0))


def bench_of(drill: str, settings: Settings) -> Bench:
    """What a tractor with these effects would log on a drill, without noise, weighed as if it had some."""
    made = next(one for one in DRILLS if one.id == drill)
    return prepare(driven(rig(), made, 0.0, 1.4, settings), rig(), {}, NOISE)


def commanded(drill: str, settings: Settings) -> Bench:
    """As bench_of, with logs that the commands alone explain to the last digit once the effects are known.

    The measured speed is that of the plain tractor: what effects of the path brake in bends is no fault of its speed.
    """
    bench = bench_of(drill, settings)
    stretches = []
    for plain in bench.course.stretches:
        wheel = chain(bench.rig, plain, settings)[2]
        steps = np.arange(len(plain.grids["speed"])) * DT_S
        turned = replace(plain, wheel=wheel, grids=plain.grids | {"wheel": np.interp(steps, plain.time, wheel)})
        pace = replay(bench.rig, turned, {}, from_sensor=True, from_speed=False)[:, FORWARD]
        log = replace(turned, speed=np.interp(plain.time, steps, pace), grids=turned.grids | {"speed": pace})
        antenna, heading, _, _ = chain(bench.rig, log, settings, by_speed=True)
        east, north, heading = (np.ascontiguousarray(one) for one in (*antenna.T, heading))
        stretches.append(replace(log, east=east, north=north, heading=heading))
    return prepare(replace(bench.course, stretches=tuple(stretches)), rig(), {}, NOISE)


def knobs(name: str) -> Knobs:
    return knobs_for(eg105(), name)


@dataclass(eq=False)
class LinearBench:
    """Surprises `base + sum(columns[name] * (value - neutral))`: what a fit of it must give is a least-squares fit."""

    base: np.ndarray
    columns: dict[str, np.ndarray]
    run_count: int = 4
    has_wheel: bool = True
    row_s: float = 0.1
    asked: list[frozenset[str]] = field(default_factory=list)

    @property
    def course(self) -> Any:
        names = tuple(f"run {one}" for one in range(self.run_count))
        return SimpleNamespace(names=names, rows=len(self.base) // 5, places={})

    @property
    def runs(self) -> np.ndarray:
        return self.block_runs[self.blocks]

    @property
    def blocks(self) -> np.ndarray:
        """Three blocks a run."""
        return np.arange(len(self.base)) * 3 * self.run_count // len(self.base)

    @property
    def block_runs(self) -> np.ndarray:
        return np.arange(3 * self.run_count) // 3

    @property
    def block_halves(self) -> np.ndarray:
        return np.arange(3 * self.run_count) % 2

    def surprise(self, settings: Settings) -> np.ndarray:
        out = self.base.copy()
        for name, values in settings.items():
            size = effect(name).size
            assert size.neutral is not None
            out += self.columns[name] * (values[size.name] - size.neutral)
        return out

    def change(self, settings: Settings, base: np.ndarray, blocks: frozenset[str]) -> np.ndarray:
        self.asked.append(blocks)
        return self.surprise(settings)

    def changes(self, asked: Sequence[Change], base: np.ndarray) -> Iterator[np.ndarray]:
        return (self.change(settings, base, blocks) for settings, blocks in asked)

    def fit(self, *names: str, at: float | None = None) -> Fit:
        """The named effects at neutral, or all at a value, with their columns."""
        parts = tuple((knobs(name), np.array(knobs(name).neutral if at is None else [at])) for name in names)
        surprise = self.surprise({one.id: one.values(place) for one, place in parts})
        return Fit(parts, surprise, np.stack([self.columns[name] for name in names] or [], axis=1) if names
                   else np.zeros((len(surprise), 0)))  # fmt: skip


def linear_bench(rows: int = 120, seed: int = 1, **truth: float) -> LinearBench:
    """Random columns for two effects, and surprises that the negative of `truth` takes away but for unit noise."""
    rng = np.random.default_rng(seed)
    columns = {name: 3.0 * rng.standard_normal(rows) for name in ("steering_offset", "heading_bias", "grip_drift")}
    base = rng.standard_normal(rows)
    for name, value in truth.items():
        base = base - columns[name] * value
    return LinearBench(base, columns)
