"""The distribution of residuals against its own draws, finite differences and closed forms."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fields.arrays import Floats
from tests.identification.analytic_drives import rig, simulated
from vehicle.identification.diagnosis import noise as noise_module
from vehicle.identification.diagnosis.drive_data import POSE_CELLS, build_drive_data
from vehicle.identification.diagnosis.model_fit import Problem
from vehicle.identification.diagnosis.noise import (
    FREEDOM,
    ChannelNoise,
    build_bridges,
    build_pose_noise,
    build_yaw_response,
    compute_memory,
    invert_lower,
)

WINDOWS, CELLS = 1500, 10
TRUE = np.log(np.square([0.5, 1.5]))


def make_noise(observed: Floats | None = None, windows: int = WINDOWS) -> ChannelNoise:
    """White noise, and noise that is forgotten in three cells."""
    parts = np.array([np.eye(CELLS), compute_memory(np.arange(CELLS, dtype=np.float64), 3.0)])
    parts = np.repeat(parts[:, None], windows, axis=1)
    seen = np.ones((windows, CELLS), dtype=np.bool_) if observed is None else observed
    return ChannelNoise(parts, TRUE.copy(), np.zeros((windows, CELLS, CELLS)), 0, seen)


def draw(noise: ChannelNoise, seed: int = 7) -> Floats:
    """Residuals of its Student t distribution: of normal windows, each with a variance of its own."""
    rng = np.random.default_rng(seed)
    spread = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, (len(noise.observed), 1)))
    white = spread * rng.standard_normal(noise.observed.shape)
    return np.linalg.solve(noise.inverse, white[:, :, None])[:, :, 0] * noise.observed


def sum_density(noise: ChannelNoise, amounts: Floats, residuals: Floats) -> float:
    noise.set_amounts(amounts)
    return float(noise.compute_log_density(noise.whiten(residuals)).sum())


@pytest.mark.parametrize("share", [1.0, 0.7])
def test_the_density_is_highest_at_the_amounts_that_were_drawn_with(share: float) -> None:
    """Also where some cells hold no sample: these tell nothing."""
    seen = np.random.default_rng(5).uniform(size=(WINDOWS, CELLS)) < share
    noise = make_noise(seen)
    residuals = draw(make_noise()) * seen
    best = sum_density(noise, TRUE, residuals)
    for number in range(2):
        for change in (-0.6, 0.6):
            moved = TRUE.copy()
            moved[number] += change
            assert sum_density(noise, moved, residuals) < best - 2.0
    noise.fit(residuals, 60)
    assert noise.amounts == pytest.approx(TRUE, abs=0.3)


def test_the_slope_of_a_fit_is_that_of_its_cost(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[Floats, Floats]] = []

    def compare(evaluate: Any, start: Floats, **_: Any) -> Any:
        place = start + np.array([0.3, -0.5])
        found = [(evaluate(place + one)[0] - evaluate(place - one)[0]) / 2e-5 for one in 1e-5 * np.eye(2)]
        seen.append((evaluate(place)[1], np.array(found)))
        return SimpleNamespace(x=start)

    monkeypatch.setattr(noise_module, "minimize", compare)
    noise = make_noise(windows=20)
    noise.fit(draw(noise), 1)
    ((slope, differences),) = seen
    assert slope == pytest.approx(differences, rel=1e-5)


def test_cells_share_the_density_of_their_window() -> None:
    noise = make_noise(windows=30)
    white = noise.whiten(draw(noise))
    cells = noise.compute_cell_densities(white)
    assert cells.sum(axis=1) == pytest.approx(noise.compute_log_density(white))


@pytest.mark.parametrize("size", [1, 20, 21, 50, 75])
def test_the_inverse_by_halves_is_the_inverse(size: int) -> None:
    rng = np.random.default_rng(size)
    lower = np.tril(rng.standard_normal((3, size, size)), -1) * 0.1 + np.eye(size) * rng.uniform(0.5, 2.0, (3, 1, size))
    assert invert_lower(lower) == pytest.approx(np.linalg.inv(lower), abs=1e-9)


@pytest.mark.parametrize("programme", ["steps", "bends-at-speeds"])
def test_a_rigid_motion_of_a_window_leaves_its_density_unchanged(programme: str) -> None:
    """Five centimetres aside and a third of a degree, against a bend of a third of a degree in the middle."""
    data = build_drive_data(simulated(programme, {}))
    tractor = rig().tractor
    ahead = tractor.antenna_forward_m
    noise, turn = build_pose_noise(data, ahead, tractor.wheelbase_m), 0.006
    shift = np.repeat([0.05, -0.05, 0.0], POSE_CELLS)
    east, north = (one.values - one.values[:, :1] for one in (data.east, data.north))
    rigid = shift + turn * np.concatenate([-north, east, np.ones_like(east)], axis=1)
    bent = turn * build_yaw_response(data, ahead)[:, :, POSE_CELLS // 2] / 0.4
    still, moved, other = (
        noise.compute_log_density(noise.whiten(one * noise.observed)) for one in (np.zeros_like(rigid), rigid, bent)
    )
    assert np.abs(moved - still).max() < 0.4 and (still - other).min() > 1.0


def test_an_angle_between_two_readings_is_off_by_when_it_changed() -> None:
    """Read every 4 s, against steps at any time in between; of angles read in every row all is known."""
    dataset = simulated("steps", {})
    assert not build_bridges(build_drive_data(dataset)).any()
    is_read = [np.isclose(one.time % 4.0, 0.0) for one in dataset.segments]
    segments = tuple(
        replace(one, wheel=0.02 * one.time, measured_rows={"angle": rows})
        for one, rows in zip(dataset.segments, is_read, strict=True)
    )
    known = build_bridges(build_drive_data(replace(dataset, segments=segments)))[0]
    middles = 0.4 * (np.arange(10) + 0.5)
    times = np.random.default_rng(3).uniform(0.0, 4.0, (20_000, 1))
    errors = 0.08 * ((times < middles) - middles / 4.0)
    assert known[:10, :10] == pytest.approx(errors.T @ errors / len(times), abs=0.02 * 0.08**2)
    assert not known[:10, 10:].any()


def test_a_pose_is_laid_on_the_measurement_before_it_is_compared() -> None:
    """The simulation may begin anywhere and in any direction."""
    problem = Problem(build_drive_data(simulated("bends-at-speeds", {})), rig())
    shown = problem.simulator.simulate({}, dict.fromkeys(("steering", "speed", "path", "instruments"), "base"))
    pose = np.stack([shown["east"], shown["north"], shown["heading"]], axis=2)
    c, s = np.cos(0.7), np.sin(0.7)
    turned = pose @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + np.array([3.0, -8.0, 0.7])
    assert problem._align(turned) == pytest.approx(problem._align(pose), abs=1e-9)
