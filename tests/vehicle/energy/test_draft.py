"""Draft of implements: worked examples of others by ASABE D497, and the table."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.energy.draft import DraftRule, find_draft_rule, get_draft_rule, load_draft_rules
from vehicle.errors import VehicleError

KMH = 1.0 / 3.6


@pytest.mark.parametrize(("name", "texture", "speed_kmh", "width_m", "depth_cm", "expected_n"), [
    # farmdss, tests/test_dss_shared.py: mouldboard plough in medium soil, 4 km/h, 2 m, 15 cm.
    ("plough", "medium", 4.0, 2.0, 15.0, 15_405.6),
    # farmdss, tests/test_reference_case_validation.py (a spreadsheet's cell C43): one bottom of 0.3 m in fine soil.
    ("plough", "fine", 2.5, 0.3, 15.0, 3_077.4375),
    # The same file: 9 tines of a cultivator for the seedbed, 15 cm deep, fine soil.
    ("cultivator-seedbed", "fine", 2.5, 9 * 0.15, 15.0, 4_961.25),
    # cabletract, tests/test_soil.py, "textbook value": a plough 1 m wide and 15 cm deep in fine soil at 8 km/h.
    ("plough", "fine", 8.0, 1.0, 15.0, 14_676.0),
])  # fmt: skip
def test_draft_as_others_work_it_out(
    name: str, texture: str, speed_kmh: float, width_m: float, depth_cm: float, expected_n: float
) -> None:
    rule = get_draft_rule(name).set_depth(depth_cm)
    assert rule.compute_draft_n(width_m, speed_kmh * KMH, texture) == pytest.approx(expected_n)  # type: ignore[arg-type]


def test_draft_and_power_of_a_chisel_plough() -> None:
    """Field and Solie 2007, Introduction to Agricultural Engineering Technology: 45 shanks, 15 cm, 10 km/h, F = 0.7."""
    rule = DraftRule(
        name="chisel", implement="chisel plough", unit="tools", a=91, b=5.4, c=0, fine=1, medium=0.7, coarse=0.45,
        depth_cm=15, spacing_m=0.3, range_pct=50,
    )  # fmt: skip
    assert rule.compute_draft_n(45 * 0.3, 10 * KMH) == pytest.approx(68_512.5)
    assert rule.compute_power_kw(45 * 0.3, 10 * KMH) == pytest.approx(190.3125)


def test_drawbar_power_of_one_plough_bottom() -> None:
    """farmdss, tests/test_reference_case_validation.py: 2.137109 kW."""
    rule = get_draft_rule("plough").set_depth(15)
    assert rule.compute_power_kw(0.3, 2.5 * KMH, "fine") == pytest.approx(2.137109, abs=1e-6)


@pytest.mark.parametrize(
    ("width_m", "expected_n"), [(1.5, 10 * 400), (2.4, 16 * 300), (3.0, 20 * 300), (6.0, 40 * 200)]
)
def test_a_drill_pulls_by_its_rows(width_m: float, expected_n: float) -> None:
    """Two copies of the standard's table count rows; by metres a drill of 3 m would pull back with 0.9 kN."""
    rule = find_draft_rule("sow", width_m)
    assert rule is not None and rule.unit == "rows" and rule.compute_draft_n(width_m, 2.0) == pytest.approx(expected_n)


@given(st.sampled_from(sorted(load_draft_rules())), st.floats(0.3, 12.0), st.floats(0.2, 6.0), st.floats(0.01, 1.0))
def test_draft_grows_with_speed_width_and_clay(name: str, width_m: float, speed_mps: float, more: float) -> None:
    rule = get_draft_rule(name)
    draft_n = rule.compute_draft_n(width_m, speed_mps)
    assert rule.compute_draft_n(width_m, speed_mps + more) >= draft_n
    assert rule.compute_draft_n(width_m * (1 + more), speed_mps) == pytest.approx(draft_n * (1 + more))
    coarse, fine = (rule.compute_draft_n(width_m, speed_mps, texture) for texture in ("coarse", "fine"))
    assert coarse <= draft_n <= fine


def test_every_row_says_where_it_comes_from() -> None:
    rules = load_draft_rules()
    assert len(rules) == 20 and all("D497" in rule.source for rule in rules.values())
    assert all(rule.spacing_m == 1.0 for rule in rules.values() if rule.unit == "m")


@given(st.sampled_from(sorted(load_draft_rules())), st.floats(0.1, 100.0))
def test_draft_is_in_proportion_to_a_depth_of_the_range_and_others_are_refused(name: str, depth_cm: float) -> None:
    rule = get_draft_rule(name)
    if rule.follows_depth and rule.min_depth_cm <= depth_cm <= rule.max_depth_cm:
        deeper = rule.set_depth(depth_cm)
        expected_n = rule.compute_draft_n(3.0, 2.0) * depth_cm / rule.depth_cm
        assert deeper.compute_draft_n(3.0, 2.0) == pytest.approx(expected_n)
    else:
        with pytest.raises(VehicleError, match=r"cm deep; give a depth in|holds for its whole depth"):
            rule.set_depth(depth_cm)


@pytest.mark.parametrize("name", ["Disk harrow", "disc_harrow", "DISK-HARROW", " disk  harrow "])
def test_an_implement_is_found_as_people_write_it(name: str) -> None:
    assert get_draft_rule(name).name == "disk-harrow"
