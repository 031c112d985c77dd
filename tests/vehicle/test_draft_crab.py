"""The crab of a tractor under the side draft of an implement: its rear axle slides out of the curve."""

from typing import Any

import numpy as np
import pytest

from fields.arrays import Floats
from tests.vehicle.bits import drive_fixed
from vehicle.identification.diagnosis.next_drive import DRIVE_PROGRAMMES, simulate_programme
from vehicle.identification.replay.drive_segments import ReplayRig, build_rig
from vehicle.identification.replay.simulation import ANGLE_COLUMN, X_COLUMN, Y_COLUMN, replay_segment
from vehicle.model.tractor import EffectSetting, Settings, Tractor, load_tractor
from vehicle.records import BODY_ANGLE, BODY_X, BODY_Y, DT_S
from vehicle.sim.calibration import build_steering_tables
from vehicle.sim.compile import build_ground_records
from vehicle.sim.dynamics import step_body
from vehicle.sim.effect_terms import compute_draft_crab_share

EG105 = load_tractor("eg105")
PACE_MPS, DRAFT_PER_M = 0.5, 0.006  # slowly, as the side force of a curve makes an axle slide out as well


def add_effects(settings: Settings) -> Tractor:
    effects = {name: EffectSetting(value=dict(value)) for name, value in settings.items()}
    return EG105.model_copy(update={"effects": effects})


def build_draft(curvature_per_m: float) -> Settings:
    return {"implement_side_draft": {"curvature_per_m": curvature_per_m}}


def drive_straight(tractor: Tractor, seconds: float = 20.0) -> Floats:
    """Body track (t, 6) in the loop that drives plans, with straight wheels and a working implement."""
    tables, steps = build_steering_tables(EG105), round(seconds / DT_S)
    return drive_fixed(tractor, tables, steps, DT_S, target_speed=PACE_MPS, working=1.0)


def measure_crab(poses: Floats) -> tuple[float, float]:
    """Curvature (1/m, positive right) of poses (n, 3), and the way of the rear axle to the right over that ahead."""
    x, y, angle = poses.T
    east, north = x - EG105.rear_axle_m * np.cos(angle), y - EG105.rear_axle_m * np.sin(angle)
    middle = 0.5 * (angle[1:] + angle[:-1])
    cosine, sine = np.cos(middle), np.sin(middle)
    ahead = float(np.sum(np.diff(east) * cosine + np.diff(north) * sine))
    return float(angle[0] - angle[-1]) / ahead, float(np.sum(np.diff(east) * sine - np.diff(north) * cosine)) / ahead


def measure_share(poses: Floats) -> float:
    curvature, crab = measure_crab(poses)
    return -crab / (curvature * EG105.wheelbase_m)


def build_soft_rig(front: float) -> ReplayRig:
    """The tractor with front tyres so many times as stiff."""
    made = build_rig(EG105, "soil", (0.0, 0.0))
    made.ground["front_slope"] *= front
    return made


@pytest.mark.slow
@pytest.mark.parametrize("front", [0.5, 1.0, 2.0])
def test_a_moment_on_tyres_makes_the_rear_axle_crab_by_its_share(front: float) -> None:
    rig = build_soft_rig(front)
    model: Any = rig.model[0]
    right = spin = 0.0
    for _ in range(1200):  # the step is implicit: it ends where tyres hold the moment that came before it
        spin += 600.0 * DT_S / float(model["inertia"])
        _, right, spin = step_body(PACE_MPS, right, spin, 0.0, 0.0, DT_S, model, rig.ground[0])
    share = -(right - EG105.rear_axle_m * spin) / (spin * EG105.wheelbase_m)
    assert share == pytest.approx(compute_draft_crab_share(model, rig.ground[0]), rel=0.03)
    assert 0.2 < share < 0.6


@pytest.mark.parametrize("draft", [DRAFT_PER_M, -DRAFT_PER_M])
def test_plans_crab_by_the_share(draft: float) -> None:
    tractor = add_effects(build_draft(draft))
    poses = drive_straight(tractor)[600:, [BODY_X, BODY_Y, BODY_ANGLE]]
    expected = compute_draft_crab_share(build_rig(EG105, "soil", (0.0, 0.0)).model[0], build_ground_records()[1])
    assert measure_share(poses) == pytest.approx(expected, rel=0.02)
    assert measure_crab(poses)[0] == pytest.approx(draft, rel=0.02)


@pytest.mark.parametrize("from_speed", [False, True])
@pytest.mark.parametrize("front", [1.0, 2.0])
def test_replays_crab_by_the_share_while_the_implement_works(from_speed: bool, front: float) -> None:
    rig = build_soft_rig(front)
    programme = next(one for one in DRIVE_PROGRAMMES if one.id == "implement-lifted")
    (segment,) = simulate_programme(rig, programme, 0.0, PACE_MPS, {}).segments
    states = replay_segment(rig, segment, build_draft(DRAFT_PER_M), False, from_speed)
    poses = states[:, [X_COLUMN, Y_COLUMN, ANGLE_COLUMN]]
    assert measure_crab(poses[60:840])[1] == pytest.approx(0.0, abs=1e-6)
    assert measure_share(poses[1020:]) == pytest.approx(compute_draft_crab_share(rig.model[0], rig.ground[0]), rel=0.02)


def test_without_side_draft_nothing_changes() -> None:
    neutral = {"steering_offset": {"angle_deg": 0.0}}
    plain, other, draft = (drive_straight(add_effects(settings)) for settings in ({}, neutral, build_draft(0.0)))
    assert np.array_equal(plain, other) and np.array_equal(plain, draft)
    rig = build_soft_rig(1.0)
    for programme in DRIVE_PROGRAMMES[:2]:
        for segment in simulate_programme(rig, programme, 0.3, PACE_MPS, {}).segments:
            for from_speed in (False, True):
                states = replay_segment(rig, segment, {}, False, from_speed)
                assert np.array_equal(states, replay_segment(rig, segment, build_draft(0.0), False, from_speed))
