"""What a tractor file has from logs, as settings and as fields; and the tractor without it."""

import math
from typing import Any

import numpy as np

from vehicle.calibration import steering_tables
from vehicle.compile import compile_model
from vehicle.effects import NEUTRAL_FIELDS, REST_KEY
from vehicle.learnt import Learnt, learnt, without_logs
from vehicle.tractor import EffectSetting, Implement, Rest, Tractor

REST = Rest(amounts={"grip_by_speed": 0.1}, speed_mps=(0.5, 2.5), angle_deg=(-20.0, 10.0))


def taught(tractor: Tractor, rest: Rest | None = REST) -> Any:
    effects = {"steering_offset": EffectSetting(value={"angle_deg": 2.0})}
    return tractor.model_copy(update={"effects": effects, "rest": rest})


def test_effects_and_rest_become_settings_and_fields(eg105: Tractor) -> None:
    own = learnt(taught(eg105))
    assert own.settings == {"steering_offset": {"angle_deg": 2.0}, REST_KEY: {"grip_by_speed": 0.1}}
    changed = {name: value for name, value in own.fields.items() if value != NEUTRAL_FIELDS[name]}
    assert changed == {
        "affected": 1.0, "offset": math.radians(2.0), "rest": 1.0, "rest_grip_by_speed": 0.1, "rest_slow": 0.5,
        "rest_fast": 2.5, "rest_left": math.radians(-20.0), "rest_right": math.radians(10.0),
    }  # fmt: skip


def test_a_rest_that_is_off_counts_for_nothing(eg105: Tractor) -> None:
    off = learnt(taught(eg105, REST.model_copy(update={"on": False})))
    assert off == Learnt({"steering_offset": {"angle_deg": 2.0}})
    assert learnt(eg105) == Learnt() and learnt(eg105).fields == NEUTRAL_FIELDS


def test_without_logs_a_tractor_is_as_it_was(eg105: Tractor) -> None:
    assert without_logs(taught(eg105)) == eg105
    assert compile_model(without_logs(taught(eg105)), Implement()) == compile_model(eg105, Implement())


def test_steering_tables_are_those_of_the_tractor_without_logs(eg105: Tractor) -> None:
    assert np.array_equal(steering_tables(taught(eg105)), steering_tables(eg105))
