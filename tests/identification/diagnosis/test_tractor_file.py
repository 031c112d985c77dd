"""A tractor as a file: what is read back is what was written."""

import math
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.model.tractor import DiscrepancyModel, EffectSetting, Tractor, load_tractor
from vehicle.model.tractor_writer import _format_value, format_tractor_toml

NAMES = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


@given(st.floats(-8.0, 8.0), NAMES, st.booleans(), st.floats(0.02, 1e6) | st.just(math.inf))
def test_a_tractor_with_effects_and_a_rest_survives_its_file(angle: float, log: str, named: bool, limit: float) -> None:
    effects = {
        "steering_offset": EffectSetting(
            value={"angle_deg": angle}, interval={"angle_deg": (angle - 1.0, angle + 1e-9)}, named=named,
            equivalent_to=("implement_side_draft",), ground="soil", logs=(log, "b"),
        ),
        "side_slip": EffectSetting(value={"limit_g": limit}),
    }  # fmt: skip
    rest = DiscrepancyModel(amounts={"push_to_east": 0.01}, speed_mps=(0.5, 2.0), angle_deg=(-10.0, 10.0), logs=(log,))
    before = load_tractor("eg105").model_copy(update={"effects": effects, "discrepancy_model": rest})
    assert Tractor(**tomllib.loads(format_tractor_toml(before))) == before


@pytest.mark.parametrize("name", ["eg105", "mr1000a"])
def test_every_shipped_tractor_survives_its_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(format_tractor_toml(load_tractor(name)), encoding="utf-8")
    assert load_tractor(path) == load_tractor(name)


def test_values_as_toml_has_them() -> None:
    texts = {"true": True, "1.0": 1.0, "0.1": 0.1, "inf": math.inf, "-inf": -math.inf}
    assert {_format_value(one): one for one in texts.values()} == texts
    assert (
        _format_value((1.5, ("a",))) == '[1.5, ["a"]]'
        and _format_value({"a b": 1.0, "c": 2.0}) == '{"a b" = 1.0, c = 2.0}'
    )
    said = 'say "hi"\t\\'
    assert tomllib.loads(f"said = {_format_value(said)}") == {"said": said}
