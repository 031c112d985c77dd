"""Parameter files: the shipped tractors, the source of every value, and refusals."""

import math
import re
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from vehicle.errors import VehicleError
from vehicle.model.ground import list_ground_names
from vehicle.model.tractor import Implement, Tractor, list_tractor_names, load_tractor
from vehicle.sim.compile import MODEL, build_model_record


def shipped(name: str) -> str:
    return (resources.files("vehicle") / "data" / f"{name}.toml").read_text(encoding="utf-8")


def values(table: dict[str, Any], prefix: str = "") -> list[str]:
    """Dotted names of everything but the name of the tractor."""
    names = []
    for key, value in table.items():
        if isinstance(value, dict):
            names += values(value, f"{prefix}{key}.")
        elif prefix + key != "name":
            names.append(prefix + key)
    return names


def test_both_tractors_ship() -> None:
    assert list_tractor_names() == ("eg105", "mr1000a")
    assert [load_tractor(name).name for name in list_tractor_names()] == ["Yanmar EG105", "Kubota MR1000A"]


@pytest.mark.parametrize("name", list_tractor_names())
def test_every_value_has_a_source(name: str) -> None:
    data = tomllib.loads(shipped(name))
    sources = data.pop("source")
    named = values(data)
    assert len(named) > 25
    for value in named:
        parts = value.split(".")
        covering = {".".join(parts[:depth]) for depth in range(1, len(parts) + 1)}
        assert covering & sources.keys(), f"{value} has no source"
    for source in sources:
        assert any(value == source or value.startswith(f"{source}.") for value in named), f"{source} is no value"
    assert all(len(text) > 5 for text in sources.values())


@pytest.mark.parametrize("name", list_tractor_names())
def test_files_leave_nothing_to_defaults(name: str) -> None:
    data = tomllib.loads(shipped(name))
    tractor = load_tractor(name)
    assert set(data) == set(Tractor.model_fields) - {"effects", "discrepancy_model", "battery"}, (
        "the first two come from measured data, and both burn diesel"
    )
    for section in ("steering", "guidance", "speed", "engine", "tyres", "stability"):
        assert set(data[section]) == set(type(getattr(tractor, section)).model_fields)
    assert set(tractor.radius) == set(list_ground_names())


def test_values_of_the_thesis() -> None:
    eg105 = load_tractor("eg105")
    assert (eg105.mass_kg, eg105.wheelbase_m, eg105.track_m) == (3850.0, pytest.approx(2.4), 1.8)
    steering, guidance = eg105.steering, eg105.guidance
    assert (steering.dead_band_deg, steering.switch_deg, steering.rate_deg_per_s) == (0.1, 5.0, 16.0)
    assert (steering.lag_s, steering.gain) == (0.1, 1.0)
    assert (guidance.lateral_gain_deg_per_m, guidance.heading_gain, guidance.rate_hz) == (30.0, 0.8, 10.0)
    # A box of 4.26 x 2.04 m: m (a^2 + b^2) / 12
    assert eg105.inertia_kg_m2 == pytest.approx(3850.0 * (4.26**2 + 2.04**2) / 12)
    assert eg105.rear_end_m == pytest.approx(1.84)


def test_parameters_cannot_be_changed() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        load_tractor("eg105").mass_kg = 1.0  # type: ignore[misc]


def test_a_file_is_read_as_a_shipped_tractor_is(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(shipped("eg105").replace("3850.0", "4000"), encoding="utf-8")
    mine = load_tractor(path)
    assert mine == load_tractor(str(path))
    assert mine.mass_kg == 4000.0
    assert mine.model_copy(update={"mass_kg": 3850.0}) == load_tractor("eg105")


@pytest.mark.parametrize(("old", "new", "sentence"), [
    ("mass_kg = 3850.0", "mass_kg = -1", r"mass_kg = -1: give a number from 0\.01 to 200000 \(kg, usually 500 to"),
    ("mass_kg = 3850.0", "mass_kg = 0", r"mass_kg = 0: give a number from 0\.01"),
    ("mass_kg = 3850.0", "mass_kg = nan", "mass_kg = nan: give a number from"),
    ("mass_kg = 3850.0", "mass_kg = true", "mass_kg = True: give a number from"),
    ("mass_kg = 3850.0", "mass_kg = 1e-308", "mass_kg = 1e-308: give a number from"),
    ("mass_kg = 3850.0", "mass_kg = 1e308", r"mass_kg = 1e\+308: give a number from"),
    ("mass_kg = 3850.0", f"mass_kg = {'9' * 4000}", "mass_kg = 9+[.]{3}: give a number from"),
    ("mass_kg = 3850.0", f"mass_kg = {'9' * 5000}", "is not TOML: it contains an integer with thousands of digits"),
    ("mass_kg = 3850.0", f"mass_kg = 0x{'f' * 9000}", "mass_kg = a int too large to show: give a number"),
    ("mass_kg = 3850.0", f"mass_kg = {'[' * 5000}", "is not TOML: it is nested 5001 levels deep"),
    ("mass_kg = 3850.0", f"mass_kg{'.a' * 3000} = 1", "is not TOML: a key in it has 3001 parts"),
    ("mass_kg = 3850.0", "mass_kg = inf", "mass_kg = inf: give a number from"),
    ("mass_kg = 3850.0", 'mass_kg = "heavy"', "mass_kg = 'heavy': give a number from"),
    ("mass_kg = 3850.0\n", "", r"it lacks mass_kg \(kg, usually 500 to 16000\)\."),
    ("mass_kg = 3850.0", "mass_kg = 3850.0\nmass_t = 3.85", r"mass_t is not known \(did you mean 'mass_kg'\?\)"),
    ("dead_band_deg = 0.1\nswitch", "dead_bnd_deg = 0.1\nswitch",
     r"steering\.dead_bnd_deg is not known \(did you mean 'dead_band_deg'\?\)"),
    ("lag_s = 0.1", "lag_s = 0", r"steering\.lag_s = 0: give a number from 1e-09 to 60 \(s\)"),
    ("rate_hz = 10.0", "rate_hz = 61", r"guidance\.rate_hz = 61: give a number from 0\.1 to 60 \(Hz\)"),
    ("max_steering_deg = 35.0", "max_steering_deg = 60", "max_steering_deg = 60: give a number above .* below 60"),
    ("length_m = 4.26", "length_m = 2.3", "wheelbase 2.4.* m is longer than length_m 2.3"),
    ("track_m = 1.8", "track_m = 2.6", "track_m 2.6 is wider than the tractor, width_m 2.04"),
    ("right = [0.5738437, 1.149]", r"right = [0.5738437]",
     r"radius\.asphalt\.right = \[0\.5738437\]: give two numbers"),
    ("right = [0.5738437, 1.149]", "right = [0.0, 1.149]",
     r"radius\.asphalt\.right\.0 = 0\.0: give a number from 0\.0001 .*factor"),
    ("track_m = 1.8", "track_m = = 1.8", "is not TOML"),
    ("rear_overhang_m = 0.74", "rear_overhang_m = 1e6", "rear_overhang_m = 1000000.0: give a number from 0 to 30"),
    ("rear_overhang_m = 0.74", "rear_overhang_m = 5", "rear_overhang_m 5.0 is more than the whole length_m 4.26"),
    ("lookahead_m = 5.0", "lookahead_m = 1e9", r"guidance\.lookahead_m = 1000000000\.0: give a number"),
    ("antenna_right_m = 0.0", "antenna_right_m = nan", "antenna_right_m = nan: give a number from -30 to 30"),
    ("latch = true", "latch = 1", r"steering\.latch = 1: give true or false"),
    ('name = "Yanmar EG105"', "name = 105", "name = 105: give a text in quotes"),
    ("[guidance]", "[guidance]\ndead_band_deg = 1.0", r"guidance\.dead_band_deg is not known here; it belongs under "),
    ("name =", "lookahead_m = 4.0\nname =", r"lookahead_m is not known here; it belongs under \[guidance\]"),
    ("[radius.asphalt]", "[discrepancy_model]\namounts = { grip_by_speed = 1e308 }\nspeed_mps = [0, 3]\n"
     "angle_deg = [-30, 30]\n[radius.asphalt]", "grip_by_speed = 1e.308; give a finite number from"),
    ("[radius.asphalt]", "[discrepancy_model]\non = true\n[radius.asphalt]",
     r"it lacks discrepancy_model\.amounts \(amount per term\), discrepancy_model\.speed_mps \(.*m/s\), "
     r"discrepancy_model\.angle_deg"),
    ("[radius.asphalt]", "[effects.side_slip]\nvalues = 1\n[radius.asphalt]", r"it lacks effects\.side_slip\.value .*"
     r"effects\.side_slip\.values is not known \(did you mean 'value'\?\)"),
])  # fmt: skip
def test_files_no_tractor_can_have_are_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    text = shipped("eg105")
    assert old in text
    path = tmp_path / "broken.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(VehicleError, match=rf"broken\.toml .*{sentence}") as refusal:
        load_tractor(path)
    assert "\n" not in str(refusal.value)


def test_unknown_names_and_unreadable_files_are_refused(tmp_path: Path) -> None:
    near = r"'eg106' is neither a file nor one of: eg105, mr1000a \(did you mean 'eg105'\?\); headland tractor new"
    with pytest.raises(VehicleError, match=near):
        load_tractor("eg106")
    with pytest.raises(VehicleError, match=r"is a folder; name a tractor file \(TOML\) in it\."):
        load_tractor(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(VehicleError, match=r"binary\.toml' is not a text file in UTF-8; give a tractor file"):
        load_tractor(tmp_path / "binary.toml")


def test_an_implement_touches_with_its_frame() -> None:
    assert Implement(width_m=3.0).contact_width_m == pytest.approx(2.7)
    assert Implement(width_m=3.0, frame_width_m=3.4).contact_width_m == 3.4
    with pytest.raises(ValidationError, match="greater than 0"):
        Implement(width_m=0.0)


def test_the_compiled_model_is_the_tractor_in_si_units() -> None:
    tractor, implement = load_tractor("eg105"), Implement(width_m=3.0, hitch_m=1.5, length_m=1.0)
    model = build_model_record(tractor, implement)
    assert model.dtype == MODEL
    degrees = {"lock": 35.0, "rate": 16.0, "dead_band": 0.1, "lateral_gain": 30.0, "switch": 5.0}
    for name, value in degrees.items():
        assert float(model[name]) == pytest.approx(math.radians(value))
    assert float(model["guide"]) == pytest.approx(0.0), "the antenna stands above the centre of mass"
    assert float(model["guide_reverse"]) == -1.1
    # Far corner of the tool: 1.1 + 1.5 + 0.5 behind, 1.35 aside.
    assert float(model["reach"]) == pytest.approx(math.hypot(3.1, 1.35))
    unlimited = {"discrepancy_slow", "discrepancy_fast", "discrepancy_left", "discrepancy_right"}
    assert all(np.isfinite(float(model[name])) for name in set(MODEL.names or ()) - unlimited)


def test_all_missing_keys_are_named_at_once_with_units(tmp_path: Path) -> None:
    path = tmp_path / "half.toml"
    path.write_text('name = "half a tractor"\nwidth_m = "2"\nwheels = 4\n[radius.soil]\nleft = [1, 1]\n')
    with pytest.raises(VehicleError) as refusal:
        load_tractor(path)
    text = str(refusal.value)
    named = re.findall(r"([a-z_.]+) \(", text.split("; width_m")[0])
    assert named == [
        "mass_kg", "front_axle_m", "rear_axle_m", "track_m", "length_m", "rear_overhang_m", "max_steering_deg",
        "radius.soil.right",
    ]  # fmt: skip
    assert "mass_kg (kg, usually" in text and "the two add up to the wheelbase" in text
    assert "width_m = '2': give a number" in text and "wheels is not known" in text
    assert text.count(". ") == 0 and "\n" not in text and text.endswith(".")


@pytest.mark.parametrize("factor", [0.1, 0.04])
def test_a_model_car_is_a_tractor(tmp_path: Path, factor: float) -> None:
    """Wheelbases of 0.24 and 0.096 m: the limits keep no model out."""
    eg105 = tomllib.loads(shipped("eg105"))
    lengths = ("front_axle_m", "rear_axle_m", "track_m", "length_m", "width_m", "rear_overhang_m", "antenna_forward_m")
    small = {name: factor * eg105[name] for name in lengths}
    lines = ['name = "model"', f"mass_kg = {3850 * factor**3}", "max_steering_deg = 35"]
    lines += [f"{name} = {value}" for name, value in small.items()]
    (tmp_path / "model.toml").write_text("\n".join(lines))
    assert load_tractor(tmp_path / "model.toml").wheelbase_m == pytest.approx(factor * 2.4)
