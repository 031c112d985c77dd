"""From the log that a link left to the name of what the tractor does otherwise, and to its file."""

import tomllib
from collections.abc import Callable
from typing import Any

import pytest

from vehicle.tractor import Tractor, load_tractor
from vehicle.twin.cause import explain
from vehicle.twin.motion import Noise
from vehicle.twin.twin import PREDICT


def test_a_hidden_effect_gets_its_name_and_comes_into_the_file(following: Callable[..., Any]) -> None:
    twin = following(PREDICT, 5.0, 0.1, noise=Noise(), hidden={"wheel_slip": 0.10}).twin
    found = explain([twin.recording.log("run")], load_tractor("eg105"))
    assert found.named == ("wheel_slip",) and "10 % slower" in found.words
    assert Tractor.model_validate(tomllib.loads(found.toml)) == found.tractor
    assert found.tractor.effects["wheel_slip"].value["ratio"] == pytest.approx(0.10, abs=0.02)
