"""Tractors from datasheets: closed forms, sources, impossible values, and circles of all plausible tractors."""

import math
import tomllib
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import count_examples
from vehicle.datasheet.build import build_tractor, describe_unusual_values
from vehicle.datasheet.sheet import QUANTITIES, REQUIRED_KEYS, build_datasheet, compute_smallest_radius_m, list_missing
from vehicle.errors import VehicleError
from vehicle.model.tractor import Tractor, load_tractor
from vehicle.model.tractor_writer import format_tractor_toml
from vehicle.sim.calibration import drive_circle

FENDT = {"wheelbase_m": 2.78, "width_m": 2.55, "turning_radius_m": 5.5}
MACHINES = {
    "robot of 0.5 t": {"wheelbase_m": 1.2, "width_m": 1.2, "turning_radius_m": 1.8, "mass_kg": 500.0},
    "orchard tractor": {"wheelbase_m": 2.05, "width_m": 1.3, "turning_radius_m": 3.2, "mass_kg": 2600.0},
    "Fendt 724": FENDT | {"mass_kg": 8000.0},
    "outer wheel": FENDT | {"mass_kg": 8000.0, "radius_of": "outer-wheel"},
    "16 t": {"wheelbase_m": 3.3, "width_m": 2.75, "turning_radius_m": 6.6, "mass_kg": 16_000.0},
    "at its tightest": FENDT | {"turning_radius_m": 2.59},
}


def made(**values: Any) -> Tractor:
    return build_tractor("one", build_datasheet(FENDT | values))


@pytest.mark.parametrize("name", MACHINES)
def test_full_lock_drives_the_datasheets_radius(name: str) -> None:
    sheet = build_datasheet(MACHINES[name])
    tractor = build_tractor(name, sheet)
    wanted = sheet.turning_radius_m
    if sheet.radius_of == "outer-wheel":
        # The outer front wheel is a wheelbase ahead of the rear axle and half a track outside its middle.
        across = math.sqrt(wanted**2 - 2.78**2) - 0.5 * tractor.track_m
        wanted = math.hypot(across, tractor.antenna_forward_m)
    for side in (1.0, -1.0):
        circle = drive_circle(tractor, side * tractor.max_steering_deg, "asphalt", seconds=30.0)
        assert circle.radius_m == pytest.approx(wanted, rel=0.01)


def test_circles_on_soil_are_wider_by_the_ratio_of_the_thesiss_tractor() -> None:
    eg105, tractor = load_tractor("eg105"), made()
    for side in (1.0, -1.0):
        ours, thesis = (
            each.get_power_law("soil").compute_radius_m(side * each.max_steering_deg)
            / each.get_power_law("asphalt").compute_radius_m(side * each.max_steering_deg)
            for each in (tractor, eg105)
        )
        assert ours == pytest.approx(thesis, rel=1e-6)
    # Half the angle is 2^p times the radius, with the exponent of the thesis.
    right = tractor.get_power_law("asphalt")
    assert right.compute_radius_m(13.65) / right.compute_radius_m(27.3) == pytest.approx(2**1.149)


def test_the_values_of_the_thesis_give_back_its_law() -> None:
    eg105 = load_tractor("eg105")
    right_m = eg105.get_power_law("asphalt").compute_radius_m(35.0)
    same = build_tractor("same", build_datasheet({
        "wheelbase_m": 2.4, "width_m": 2.04, "turning_radius_m": right_m, "max_steering_deg": 35.0, "mass_kg": 3850.0,
    }))  # fmt: skip
    assert same.get_power_law("asphalt").right == pytest.approx(eg105.get_power_law("asphalt").right, rel=1e-6)
    assert same.get_power_law("soil").right == pytest.approx(eg105.get_power_law("soil").right, rel=1e-6)
    assert same.speed.proportional_n_s_per_m == eg105.speed.proportional_n_s_per_m
    assert (same.guidance, same.length_m, same.rear_overhang_m) == (eg105.guidance, 4.26, 0.74)


def test_full_lock_is_the_angle_of_ackermann() -> None:
    tractor = made()
    assert tractor.rear_axle_m == pytest.approx(0.4 * 2.78)  # 40 % of the weight in front
    assert tractor.wheelbase_m == pytest.approx(2.78)
    across = math.sqrt(5.5**2 - tractor.antenna_forward_m**2)
    assert tractor.max_steering_deg == pytest.approx(math.degrees(math.atan(2.78 / across)), abs=0.006)


def test_mass_by_power_and_by_footprint() -> None:
    assert made(power_kw=77.0).mass_kg == 3850.0  # the tractor of the thesis: 105 hp, 3850 kg
    assert made(power_kw=77.0, mass_kg=4000.0).mass_kg == 4000.0
    # Twice the wheelbase and the width: the footprint is 4 times, the mass 16 times as large.
    small = build_datasheet({"wheelbase_m": 1.2, "width_m": 1.02, "turning_radius_m": 2.0})
    assert build_tractor("small", small).mass_kg == pytest.approx(3850.0 / 16.0, rel=0.01)


def test_forces_grow_with_the_mass() -> None:
    light, heavy = made(mass_kg=4000.0), made(mass_kg=8000.0)
    for key in ("proportional_n_s_per_m", "integral_n_per_m", "derivative_n_s2_per_m", "max_drive_n"):
        assert getattr(heavy.speed, key) == pytest.approx(2.0 * getattr(light.speed, key), rel=1e-4)
    assert heavy.speed.max_drive_n == pytest.approx(0.4 * 8000.0 * 9.80665, abs=0.1)


def test_a_tighter_turn_has_quicker_wheels() -> None:
    assert made().steering.rate_deg_per_s == 16.0
    robot = build_tractor("robot", build_datasheet(MACHINES["robot of 0.5 t"]))
    # Half the radius of the thesis's tractor at as large an angle: twice the rate.
    assert robot.steering.rate_deg_per_s == pytest.approx(2.0 * 16.0, rel=0.05)
    assert made(steering_rate_deg_per_s=25.0).steering.rate_deg_per_s == 25.0


@pytest.mark.parametrize("values", [{}, {"power_kw": 174.0}, {"mass_kg": 8000.0, "length_m": 5.2, "track_m": 1.9}])
def test_every_value_has_a_source(values: dict[str, float]) -> None:
    data = tomllib.loads(format_tractor_toml(made(**values)))
    source = data.pop("source")
    named = {key for key, value in data.items() if not isinstance(value, dict)} - {"name"}
    named |= {f"{section}.{key}" for section in ("steering", "guidance", "speed") for key in data[section]}
    named |= {f"radius.{ground}" for ground in data["radius"]}
    named |= {"engine.power_kw"} if "power_kw" in values else set()
    assert data.get("engine", {}).get("power_kw") == values.get("power_kw"), "by which plans check what it can pull"
    assert set(source) == named
    assert all(words.startswith(("given", "assumed: ")) for words in source.values())
    assert source["width_m"] == "given"
    for key in {"mass_kg", "length_m", "track_m"} & set(data):
        assert (source[key] == "given") == (key in values), key


def test_missing_values_are_named_with_unit_and_usual_range() -> None:
    with pytest.raises(VehicleError) as refused:
        build_datasheet({"wheelbase_m": 2.78})
    said = str(refused.value)
    assert "width_m (width over all, m, usually 0.8 to 3)" in said
    assert "turning_radius_m" in said and "wheelbase_m" not in said
    assert len(list_missing({})) == len(REQUIRED_KEYS) == 3


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"width_m": 25.5}, "perhaps 2.55"),
        ({"wheelbase_m": 278.0}, "perhaps 2.78"),
        ({"mass_kg": -1.0}, "use 20 to 60000"),
        ({"wheelbase_m": math.nan}, "wheelbase_m is nan"),
        ({"turning_radius_m": 2.0}, "use 2.59 m or more"),
        ({"length_m": 2.0}, "length_m is 2 m"),
        ({"length_m": 4.0, "rear_overhang_m": 1.5}, "leave 1.22 m"),
        ({"track_m": 2.6}, "wider than the tractor"),
        ({"width_m": 0.4}, "check both"),
        ({"radius_of": "inner"}, "use centre or outer-wheel"),
    ],
)
def test_an_impossible_value_is_one_sentence_with_the_fix(values: dict[str, Any], words: str) -> None:
    with pytest.raises(VehicleError) as refused:
        build_datasheet(FENDT | values)
    assert words in str(refused.value)
    assert refused.value.parameter in values


def test_all_impossible_values_are_reported_at_once() -> None:
    with pytest.raises(VehicleError) as refused:
        build_datasheet({"wheelbase_m": 27.8, "width_m": 25.5, "turning_radius_m": 55.0})
    assert all(name in str(refused.value) for name in REQUIRED_KEYS)


def test_the_smallest_radius_is_that_of_the_sharpest_angle() -> None:
    sheet = build_datasheet(FENDT)
    assert compute_smallest_radius_m(sheet) == pytest.approx(math.hypot(1.112, 2.78 / math.tan(math.radians(50.0))))


def test_odd_values_cause_a_remark() -> None:
    assert describe_unusual_values(build_datasheet(FENDT)) == ()
    assert "diameter" in describe_unusual_values(build_datasheet(FENDT | {"turning_radius_m": 11.0}))[0]
    assert "need 27.3" in describe_unusual_values(build_datasheet(FENDT | {"max_steering_deg": 50.0}))[0]


def plausible(name: str) -> st.SearchStrategy[float]:
    quantity = QUANTITIES[name]
    return st.floats(quantity.usual_low, quantity.usual_high).map(lambda value: round(value, 3))


@st.composite
def datasheets(draw: st.DrawFn) -> dict[str, float]:
    """Usual values of a tractor, in proportion, some of them left out."""
    base = draw(plausible("wheelbase_m"))
    values = {
        "wheelbase_m": base,
        "width_m": round(base * draw(st.floats(0.5, 1.2)), 3),
        "turning_radius_m": round(base * draw(st.floats(1.1, 4.0)), 3),
    }
    for name in ("mass_kg", "power_kw", "steering_rate_deg_per_s", "front_share", "max_steering_deg"):
        if draw(st.booleans()):
            values[name] = draw(plausible(name))
    if draw(st.booleans()):
        values["length_m"] = round(base * draw(st.floats(1.4, 2.5)), 3)
    return values


@settings(max_examples=count_examples(25))
@given(datasheets())
def test_any_plausible_datasheet_drives_its_circle(values: dict[str, float]) -> None:
    tractor = build_tractor("any", build_datasheet(values))
    assert Tractor.model_validate(tomllib.loads(format_tractor_toml(tractor))) == tractor
    for ground in ("asphalt", "soil"):
        asked = tractor.get_power_law(ground).compute_radius_m(tractor.max_steering_deg)
        driven = drive_circle(tractor, tractor.max_steering_deg, ground, seconds=30.0).radius_m
        assert driven == pytest.approx(asked, rel=0.01)
    assert tractor.get_power_law("asphalt").compute_radius_m(-tractor.max_steering_deg) == pytest.approx(
        values["turning_radius_m"], rel=1e-6
    )
