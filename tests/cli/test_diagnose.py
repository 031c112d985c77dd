"""`diagnose --demo --json` says what it hid beside what it found."""

import json
from collections.abc import Callable
from typing import Any

from vehicle.identification.verdict.demo_logs import draw_hidden_effect
from vehicle.model.tractor import load_tractor


def test_the_demonstration_says_what_it_hid(headland: Callable[..., Any]) -> None:
    outcome = headland("diagnose", "--demo", "--seed", "3", "--hide", "steering_gain", "--json")
    assert outcome.status == 0, outcome.err
    found = json.loads(outcome.out)
    hidden = draw_hidden_effect(3, load_tractor("eg105"), "steering_gain")
    assert found["hidden"] == {"id": "steering_gain", "value": hidden.values, "words": hidden.description}
    assert found["named"] == ["steering_gain"]
    low, high = next(one["interval"]["ratio"] for one in found["effects"] if one["id"] == "steering_gain")
    assert low <= hidden.values["ratio"] <= high
    assert found["plan"]["field"] == "iwamizawa" and found["tractor"]["effects"]["steering_gain"]["named"] is True
