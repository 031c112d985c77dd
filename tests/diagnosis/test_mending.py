"""What a tractor file gets of an extension."""

import pytest

from tests.diagnosis.hiding import eg105, hidden
from tests.truth.drives import default_programme
from tests.truth.model import make_logs
from vehicle.identification.diagnosis.demo_logs import draw_hidden_effect, simulate_demo_logs
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.logs.reader import build_log
from vehicle.model.tractor import EffectSetting


@pytest.mark.slow
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
