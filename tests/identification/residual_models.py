"""Benches for tests: noise-free drives of the simulator itself, and a stand-in whose residuals are linear."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from vehicle.identification.fit.effect_parameters import EffectParameters, build_parameters
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.replay.drive_programmes import DRIVE_PROGRAMMES, simulate_programme
from vehicle.identification.replay.horizon_errors import simulate_instruments
from vehicle.identification.replay.rig import ReplayRig, build_rig, replay_segment
from vehicle.identification.replay.state_cache import FORWARD_COLUMN
from vehicle.identification.residuals.innovations import NoiseLevels
from vehicle.identification.residuals.residual_model import ResidualModel, SettingsChange, build_residual_model
from vehicle.model.effects import get_effect
from vehicle.model.tractor import Tractor, load_tractor
from vehicle.records import DT_S

Settings = Mapping[str, Mapping[str, float]]
# Position, its drift, heading, its drift, soil and way of an ordinary receiver on an ordinary field.
NOISE = NoiseLevels(0.010, 0.015, 0.002, 0.0017, 0.0025, 0.006)
DRAFT_PER_M = 0.006


@lru_cache(maxsize=1)
def eg105() -> Tractor:
    return load_tractor("eg105")


@lru_cache(maxsize=1)
def rig() -> ReplayRig:
    return build_rig(eg105(), "soil", (0.0, 0.0))


def build_programme_model(programme: str, settings: Settings) -> ResidualModel:
    """What a tractor with these effects would log on a programme, without noise, weighed as if it had some."""
    made = next(one for one in DRIVE_PROGRAMMES if one.id == programme)
    return build_residual_model(simulate_programme(rig(), made, 0.0, 1.4, settings), rig(), {}, NOISE)


def build_draft_model(programme: str, rear: float) -> ResidualModel:
    """Logs of a side draft on rear tyres so many times as stiff, which decides how far the rear axle slides out."""
    ground = rig().ground.copy()
    ground["rear_slope"] *= rear
    made = next(one for one in DRIVE_PROGRAMMES if one.id == programme)
    effects = {"implement_side_draft": {"curvature_per_m": DRAFT_PER_M}}
    dataset = simulate_programme(replace(rig(), ground=ground), made, 0.0, 1.4, effects)
    return build_residual_model(dataset, rig(), {}, NOISE)


def build_commanded_model(programme: str, settings: Settings) -> ResidualModel:
    """As build_programme_model, with logs that the commands alone explain to the last digit once the effects are known.

    The measured speed is that of the plain tractor: what effects of the path brake in bends is no fault of its speed.
    """
    residual_model = build_programme_model(programme, settings)
    segments = []
    for plain in residual_model.dataset.segments:
        wheel = simulate_instruments(residual_model.rig, plain, settings)[2]
        steps = np.arange(len(plain.grids["speed"])) * DT_S
        turned = replace(plain, wheel=wheel, grids=plain.grids | {"wheel": np.interp(steps, plain.time, wheel)})
        pace = replay_segment(residual_model.rig, turned, {}, from_sensor=True, from_speed=False)[:, FORWARD_COLUMN]
        log = replace(turned, speed=np.interp(plain.time, steps, pace), grids=turned.grids | {"speed": pace})
        antenna, heading, _, _ = simulate_instruments(residual_model.rig, log, settings, by_speed=True)
        east, north, heading = (np.ascontiguousarray(one) for one in (*antenna.T, heading))
        segments.append(replace(log, east=east, north=north, heading=heading))
    return build_residual_model(replace(residual_model.dataset, segments=tuple(segments)), rig(), {}, NOISE)


def get_parameters(name: str) -> EffectParameters:
    return build_parameters(eg105(), name)


@dataclass(eq=False)
class LinearResidualModel:
    """Residuals `base + sum(columns[name] * (value - neutral))`: what a fit of it must give is a least-squares fit."""

    base: np.ndarray
    columns: dict[str, np.ndarray]
    run_count: int = 4
    has_measured_wheel_angle: bool = True
    row_interval_s: float = 0.1
    requests: list[frozenset[str]] = field(default_factory=list)

    @property
    def dataset(self) -> Any:
        names = tuple(f"run {one}" for one in range(self.run_count))
        return SimpleNamespace(names=names, rows=len(self.base) // 5, effect_places={})

    @property
    def residual_runs(self) -> np.ndarray:
        return self.block_runs[self.residual_blocks]

    @property
    def residual_blocks(self) -> np.ndarray:
        """Three blocks a run."""
        return np.arange(len(self.base)) * 3 * self.run_count // len(self.base)

    @property
    def block_runs(self) -> np.ndarray:
        return np.arange(3 * self.run_count) // 3

    @property
    def block_halves(self) -> np.ndarray:
        return np.arange(3 * self.run_count) % 2

    def get_interval_s(self, name: str) -> float:
        return self.row_interval_s

    def compute_residuals(self, settings: Settings) -> np.ndarray:
        out = self.base.copy()
        for name, values in settings.items():
            size = get_effect(name).size
            assert size.neutral is not None
            out += self.columns[name] * (values[size.name] - size.neutral)
        return out

    def compute_change(self, settings: Settings, base: np.ndarray, blocks: frozenset[str]) -> np.ndarray:
        self.requests.append(blocks)
        return self.compute_residuals(settings)

    def compute_changes(self, requests: Sequence[SettingsChange], base: np.ndarray) -> Iterator[np.ndarray]:
        return (self.compute_change(settings, base, blocks) for settings, blocks in requests)

    def fit(self, *names: str, at: float | None = None) -> EffectFit:
        """The named effects at neutral, or all at a value, with their columns."""
        parts = tuple(
            (get_parameters(name), np.array(get_parameters(name).neutral if at is None else [at])) for name in names
        )
        residuals = self.compute_residuals({one.id: one.compute_values(place) for one, place in parts})
        return EffectFit(
            parts,
            residuals,
            np.stack([self.columns[name] for name in names] or [], axis=1) if names else np.zeros((len(residuals), 0)),
        )


def build_linear_model(rows: int = 120, seed: int = 1, **truth: float) -> LinearResidualModel:
    """Random columns for two effects, and residuals that the negative of `truth` takes away but for unit noise."""
    rng = np.random.default_rng(seed)
    columns = {name: 3.0 * rng.standard_normal(rows) for name in ("steering_offset", "heading_bias", "grip_drift")}
    base = rng.standard_normal(rows)
    for name, value in truth.items():
        base = base - columns[name] * value
    return LinearResidualModel(base, columns)
