"""A quick part of the matrix: seven to nine runs of the independent truth model.

More effects are named in test_second_reference.py, in fewer runs of another reference.
"""

import math

import pytest

from tests.diagnosis.hiding import brief_programme, diagnosed, hidden, judge
from tests.examples import draw_seed, seldom
from tests.truth.drives import one_way_programme

RATE_HZ = 10.0
"""Of logs whose effect is so large that half of the rows show it too."""


@pytest.fixture(scope="module")
def seed() -> int:
    return draw_seed()


def test_nothing_hidden_nothing_named(seed: int) -> None:
    found = diagnosed({}, seed, brief_programme())
    assert not found.named, f"seed {seed}: {found.named}"
    assert found.unexplained_share == 0.0 and found.next_drive is None
    assert not found.tractor.effects and found.headline.startswith("Nothing found")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "steering_offset",
        *(pytest.param(name, marks=pytest.mark.matrix) for name in ("steering_rate", "antenna_forward")),
    ],
)
def test_the_hidden_effect_is_named(name: str, seed: int) -> None:
    found = diagnosed(hidden([name]), seed, brief_programme())
    verdict = judge(found, hidden([name]))
    assert verdict.found and not verdict.wrong and verdict.close, f"seed {seed}: {verdict.text}"
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
    found = diagnosed(hidden(["implement_side_draft"]), seed, one_way_programme(), rate_hz=RATE_HZ)
    pair = [one for one in found.findings if one.id in ("implement_side_draft", "steering_offset")]
    assert not found.named, f"seed {seed}: {found.named}"
    assert all(one.status != "refuted" for one in pair), f"seed {seed}: {[one.status for one in pair]}"


@pytest.mark.parametrize("fixed", seldom(503, 506))
def test_a_simplification_of_the_simulator_is_no_cause(fixed: int) -> None:
    """Seeds in which the end of a steering movement, which the simulator simplifies, once passed for a fault."""
    assert not diagnosed({}, fixed, brief_programme()).named
