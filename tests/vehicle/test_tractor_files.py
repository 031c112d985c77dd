"""Parameter files: what ships, where every value is from, and what is refused."""

import math
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from vehicle.compile import compile_model
from vehicle.errors import VehicleError
from vehicle.ground import ground_names
from vehicle.layout import MODEL
from vehicle.tractor import Implement, Tractor, load_tractor, tractor_names


def shipped(name: str) -> str:
    return (resources.files("vehicle") / "data" / f"{name}.toml").read_text(encoding="utf-8")


def values(table: dict[str, Any], prefix: str = "") -> list[str]:
    """Dotted names of everything that is a number or a list of numbers."""
    names = []
    for key, value in table.items():
        if isinstance(value, dict):
            names += values(value, f"{prefix}{key}.")
        elif not isinstance(value, str):
            names.append(prefix + key)
    return names


def test_both_tractors_ship() -> None:
    assert tractor_names() == ("eg105", "mr1000a")
    assert [load_tractor(name).name for name in tractor_names()] == ["Yanmar EG105", "Kubota MR1000A"]


@pytest.mark.parametrize("name", tractor_names())
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


@pytest.mark.parametrize("name", tractor_names())
def test_files_leave_nothing_to_defaults(name: str) -> None:
    data = tomllib.loads(shipped(name))
    tractor = load_tractor(name)
    assert set(data) == set(Tractor.model_fields) - {"effects", "rest"}, "these come from measured data"
    for section in ("steering", "guidance", "speed"):
        assert set(data[section]) == set(type(getattr(tractor, section)).model_fields)
    assert set(tractor.radius) == set(ground_names())


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
    ("mass_kg = 3850.0", "mass_kg = -1", "mass_kg = -1: .*greater than 0"),
    ("mass_kg = 3850.0", "mass_kg = 0", "mass_kg = 0: .*greater than 0"),
    ("mass_kg = 3850.0", "mass_kg = nan", "mass_kg = nan"),
    ("mass_kg = 3850.0", "mass_kg = inf", "mass_kg = inf: .*finite"),
    ("mass_kg = 3850.0", 'mass_kg = "heavy"', "mass_kg = 'heavy': .*number"),
    ("mass_kg = 3850.0\n", "", "mass_kg = .*Field required"),
    ("mass_kg = 3850.0", "mass_kg = 3850.0\nmass_t = 3.85", "mass_t = 3.85: .*not permitted"),
    ("dead_band_deg = 0.1\nswitch", "dead_bnd_deg = 0.1\nswitch", "steering.dead_bnd_deg = 0.1: .*not permitted"),
    ("lag_s = 0.1", "lag_s = 0", "steering.lag_s = 0: .*greater than 0"),
    ("rate_hz = 10.0", "rate_hz = 61", "guidance.rate_hz = 61: .*less than or equal to 60"),
    ("max_steering_deg = 35.0", "max_steering_deg = 60", "max_steering_deg = 60: .*less than 60"),
    ("length_m = 4.26", "length_m = 2.3", "wheelbase 2.4.* m is longer than length_m 2.3"),
    ("track_m = 1.8", "track_m = 2.6", "track_m 2.6 is wider than the tractor, width_m 2.04"),
    ("right = [0.5738437, 1.149]", "right = [0.5738437]", "radius.asphalt.right"),
    ("right = [0.5738437, 1.149]", "right = [0.0, 1.149]", "radius.asphalt.right.0 = 0.0: .*greater than 0"),
    ("track_m = 1.8", "track_m = = 1.8", "is not TOML"),
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
    with pytest.raises(VehicleError, match=r"'eg106' is neither a file .* nor one of: eg105, mr1000a\."):
        load_tractor("eg106")
    with pytest.raises(VehicleError, match="neither a file"):
        load_tractor(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(VehicleError, match=r"binary\.toml is not a text file; give a TOML file"):
        load_tractor(tmp_path / "binary.toml")


def test_an_implement_touches_with_its_frame() -> None:
    assert Implement(width_m=3.0).contact_width_m == pytest.approx(2.7)
    assert Implement(width_m=3.0, frame_width_m=3.4).contact_width_m == 3.4
    with pytest.raises(ValidationError, match="greater than 0"):
        Implement(width_m=0.0)


def test_the_compiled_model_is_the_tractor_in_si_units() -> None:
    tractor, implement = load_tractor("eg105"), Implement(width_m=3.0, hitch_m=1.5, length_m=1.0)
    model = compile_model(tractor, implement)
    assert model.dtype == MODEL
    degrees = {"lock": 35.0, "rate": 16.0, "dead_band": 0.1, "lateral_gain": 30.0, "switch": 5.0}
    for name, value in degrees.items():
        assert float(model[name]) == pytest.approx(math.radians(value))
    assert float(model["guide"]) == pytest.approx(0.0), "the antenna stands above the centre of mass"
    assert float(model["guide_reverse"]) == -1.1
    # Far corner of the tool: 1.1 + 1.5 + 0.5 behind, 1.35 aside.
    assert float(model["reach"]) == pytest.approx(math.hypot(3.1, 1.35))
    unlimited = {"rest_slow", "rest_fast", "rest_left", "rest_right"}
    assert all(np.isfinite(float(model[name])) for name in set(MODEL.names or ()) - unlimited)
