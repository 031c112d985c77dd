"""Parts of the extension: two grounds, and what a tractor file gets."""

import numpy as np
import pytest

from tests.diagnosis.hiding import eg105, hidden
from tests.truth.drives import default_programme
from tests.truth.model import make_logs
from vehicle.identification.diagnosis.demo_logs import HiddenEffect, draw_hidden_effect, simulate_demo_logs
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.logs.reader import build_log
from vehicle.identification.replay.drive_segments import compute_half_numbers
from vehicle.model.tractor import EffectSetting

FAST = ("fast_circles", "fast_steps", "speed_steps", "circles_right")


def test_halves_change_every_twenty_seconds() -> None:
    assert compute_half_numbers(np.array([0.0, 19.9, 20.0, 39.9, 40.0])).tolist() == [0, 0, 1, 1, 0]


@pytest.mark.matrix
def test_two_grounds_are_told_apart() -> None:
    drives = [drive for drive in default_programme() if drive.name in FAST]
    logs = []
    for ground, limit, seed in (("dry", 0.16, 5), ("wet", 0.07, 6)):
        frames = make_logs({"side_slip": {"limit_g": limit}}, seed, drives, rate_hz=10.0)
        logs += [build_log(frame, f"{ground} {frame.attrs['name']}") for frame in frames]
    found = diagnose_logs(logs, eg105(), "soil")
    assert set(found.named) <= {"side_slip"}
    runs = [set(one.runs) for one in sorted(found.grounds, key=lambda one: one.value["limit_g"])]
    assert runs == [{"wet fast_circles", "wet fast_steps"}, {"dry fast_circles", "dry fast_steps"}]
    assert found.after[5.0].cross_cm < 0.7 * found.before[5.0].cross_cm


@pytest.mark.matrix
def test_slip_on_half_the_runs_is_told_with_its_runs() -> None:
    slipping = simulate_demo_logs(HiddenEffect("wheel_slip", {"ratio": 0.15}), eg105(), "soil", 41)[::2]
    plain = simulate_demo_logs(None, eg105(), "soil", 41)[1::2]
    found = diagnose_logs([*slipping, *plain], eg105(), "soil")
    assert found.named == ("wheel_slip",)
    wet = next(one for one in found.grounds if abs(one.value["ratio"] - 0.15) < 0.02)
    assert set(wet.runs) <= {log.name for log in slipping} and len(wet.runs) >= 4
    assert found.unexplained_share == 0.0 and not any(run.unlike for run in found.runs)
    assert any("on two grounds, or of two tractors" in note for note in found.notes)


def test_effects_of_the_file_count_before_and_are_fitted_anew() -> None:
    hiding = draw_hidden_effect(4, eg105(), "steering_offset")
    known = EffectSetting(value=hiding.values)
    unseen = EffectSetting(value={"limit_g": 0.3})
    tractor = eg105().model_copy(update={"effects": {"steering_offset": known, "side_slip": unseen}})
    straight = [log for log in simulate_demo_logs(hiding, eg105(), "soil", 4) if log.name.startswith("straight")]
    found = diagnose_logs(straight, tractor, "soil")
    assert found.before[5.0].cross_cm < 1.1 * found.noise_floor[5.0].cross_cm
    assert "steering_offset" in found.tractor.effects
    assert found.tractor.effects["side_slip"] == unseen
    assert any("already" in note for note in found.notes)


def test_one_run_is_held_out_by_its_own_windows() -> None:
    frames = make_logs(hidden(["steering_offset"]), 3, [d for d in default_programme() if d.name == "figure_eight"])
    found = diagnose_logs([build_log(frames[0], "only")], eg105(), "soil")
    offset = next(one for one in found.findings if one.id == "steering_offset")
    assert offset.gain_pct is not None and offset.gain_pct > 0.0
    assert any("20 s windows" in note for note in found.notes)
