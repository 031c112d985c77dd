"""A quick part of the matrix: seven to nine runs of the independent truth model.

More effects are named in test_second_reference.py, in fewer runs of another reference.
"""

import math

import numpy as np
import pytest

from tests.diagnosis.hiding import brief_programme, diagnosed, eg105, hidden
from tests.examples import draw_seed, seldom
from tests.truth.drives import one_way_programme
from tests.truth.model import Truth
from vehicle.identification.diagnosis.demo_logs import simulate_demo_logs
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.results import EQUIVALENT
from vehicle.identification.logs.reader import build_log

RATE_HZ = 10.0
"""Of logs that half of the rows are enough for."""


@pytest.fixture(scope="module")
def seed() -> int:
    return draw_seed()


@pytest.mark.slow
def test_nothing_hidden_nothing_named(seed: int) -> None:
    found = diagnosed({}, seed, brief_programme(), rate_hz=RATE_HZ)
    assert not found.named, f"seed {seed}: {found.named}"
    assert found.unexplained_share == 0.0 and found.next_drive is None
    assert not found.tractor.effects and found.headline.startswith("Nothing found")


@pytest.mark.matrix
@pytest.mark.parametrize("name", ["steering_offset", "steering_rate", "antenna_forward"])
def test_the_hidden_effect_is_named(name: str, seed: int) -> None:
    found = diagnosed(hidden([name]), seed, brief_programme())
    assert found.named == (name,), f"seed {seed}: {found.named}"
    (said,) = (one for one in found.findings if one.id == name)
    assert said.value is not None and said.interval is not None
    for key, truth in hidden([name])[name].items():
        low, high = said.interval[key]
        assert said.value[key] == pytest.approx(truth, rel=0.15) or low <= truth <= high, f"seed {seed}: {said}"
    assert set(found.tractor.effects) == set(found.named)
    assert found.tractor.effects[name].logs == found.names
    assert found.after[5.0].cross_cm <= found.before[5.0].cross_cm * 1.02


@pytest.mark.matrix
def test_an_effect_outside_the_catalogue_gets_no_name(seed: int) -> None:
    found = diagnosed(hidden(["wind_drift"]), seed, brief_programme(), rate_hz=RATE_HZ)
    assert not found.named, f"seed {seed}: {found.named}"
    assert found.unexplained_share > 0.3
    assert any("direction of travel" in one for one in found.depends_on)
    rest = found.tractor.discrepancy_model
    assert rest is not None and set(rest.amounts) == {"push_to_east", "push_to_north"}, f"seed {seed}: {rest}"
    bearing = math.degrees(math.atan2(rest.amounts["push_to_east"], rest.amounts["push_to_north"]))
    assert bearing == pytest.approx(60.0, abs=15.0)
    assert math.hypot(*rest.amounts.values()) == pytest.approx(0.05, rel=0.15)
    assert found.after[5.0].along_cm < 0.6 * found.before[5.0].along_cm


@pytest.mark.slow
def test_a_one_way_drive_names_neither_an_offset_nor_a_draft(seed: int) -> None:
    """Driven one way with the implement at work both look alike; neither may be refuted."""
    found = diagnosed(hidden(["implement_side_draft"]), seed, one_way_programme(), rate_hz=5.0)
    pair = [one for one in found.findings if one.id in ("implement_side_draft", "steering_offset")]
    assert not found.named, f"seed {seed}: {found.named}"
    assert all(one.status != "refuted" for one in pair), f"seed {seed}: {[one.status for one in pair]}"


@pytest.mark.matrix
@pytest.mark.parametrize("name", ["steering_offset", "implement_side_draft", "cross_slope_drift", "heading_bias"])
def test_one_way_drives_leave_a_set_and_the_drive_that_decides(name: str, seed: int) -> None:
    found = diagnosed(hidden([name]), seed, one_way_programme())
    assert not found.named and found.next_drive is not None, f"seed {seed}: {found.named}"
    assert name in {one.id for one in found.findings if one.status == EQUIVALENT}


@pytest.mark.parametrize("fixed", seldom(503, 506))
def test_a_simplification_of_the_simulator_is_no_cause(fixed: int) -> None:
    """Seeds in which the end of a steering movement, which the simulator simplifies, once passed for a fault."""
    assert not diagnosed({}, fixed, brief_programme()).named


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [pytest.param(5.0, marks=pytest.mark.matrix), 2.0])
def test_nothing_is_claimed_that_lies_between_two_rows(rate_hz: float) -> None:
    found = diagnose_logs(simulate_demo_logs(None, eg105(), "soil", 41, rate_hz=rate_hz), eg105(), "soil")
    assert not found.named and found.unexplained_share == 0.0
    assert not any(one.named for one in found.tractor.effects.values())


@pytest.mark.slow
def test_scatter_between_runs_does_not_hide_what_they_have_in_common() -> None:
    """8 % of slip, 0.3 % more or less from run to run: a value per run predicts more, the cause is the common one."""
    scatter, logs = np.random.default_rng(5), []
    for number, drive in enumerate(brief_programme()):
        slip = {"wheel_slip": {"ratio": 0.08 + 0.003 * float(scatter.standard_normal())}}
        frame = Truth(slip, 11, rate_hz=RATE_HZ).log(drive, number)
        logs.append(build_log(frame, frame.attrs["name"]))
    found = diagnose_logs(logs, eg105(), "soil")
    assert found.named == ("wheel_slip",)
    (slip,) = [one for one in found.findings if one.id == "wheel_slip"]
    assert slip.value is not None and slip.value["ratio"] == pytest.approx(0.08, abs=0.005)
