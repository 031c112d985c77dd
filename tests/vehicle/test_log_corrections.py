"""Corrections from logs in a tractor file, as settings and fields, and the tractor without them."""

import math
from typing import Any

import numpy as np

from vehicle.model.effects import DISCREPANCY_KEY, NEUTRAL_FIELDS
from vehicle.model.tractor import (
    DiscrepancyModel,
    EffectSetting,
    Implement,
    LogCorrections,
    Tractor,
    get_log_corrections,
    remove_log_corrections,
)
from vehicle.sim.calibration import build_steering_tables
from vehicle.sim.compile import build_model_record

DISCREPANCY = DiscrepancyModel(amounts={"grip_by_speed": 0.1}, speed_mps=(0.5, 2.5), angle_deg=(-20.0, 10.0))


def add_corrections(tractor: Tractor, model: DiscrepancyModel | None = DISCREPANCY) -> Any:
    effects = {"steering_offset": EffectSetting(value={"angle_deg": 2.0})}
    return tractor.model_copy(update={"effects": effects, "discrepancy_model": model})


def test_effects_and_discrepancy_model_become_settings_and_fields(eg105: Tractor) -> None:
    own = get_log_corrections(add_corrections(eg105))
    assert own.settings == {"steering_offset": {"angle_deg": 2.0}, DISCREPANCY_KEY: {"grip_by_speed": 0.1}}
    changed = {name: value for name, value in own.fields.items() if value != NEUTRAL_FIELDS[name]}
    assert changed == {
        "affected": 1.0, "offset": math.radians(2.0), "discrepancy_model": 1.0, "discrepancy_grip_by_speed": 0.1,
        "discrepancy_slow": 0.5, "discrepancy_fast": 2.5, "discrepancy_left": math.radians(-20.0),
        "discrepancy_right": math.radians(10.0),
    }  # fmt: skip


def test_a_discrepancy_model_that_is_off_is_ignored(eg105: Tractor) -> None:
    off = get_log_corrections(add_corrections(eg105, DISCREPANCY.model_copy(update={"on": False})))
    assert off == LogCorrections({"steering_offset": {"angle_deg": 2.0}})
    assert get_log_corrections(eg105) == LogCorrections() and get_log_corrections(eg105).fields == NEUTRAL_FIELDS


def test_without_logs_a_tractor_is_as_it_was(eg105: Tractor) -> None:
    bare = remove_log_corrections(add_corrections(eg105))
    assert bare == eg105
    assert build_model_record(bare, Implement()) == build_model_record(eg105, Implement())


def test_steering_tables_are_those_of_the_tractor_without_logs(eg105: Tractor) -> None:
    assert np.array_equal(build_steering_tables(add_corrections(eg105)), build_steering_tables(eg105))
