"""A tractor made ready for replay: what planning compiles of it, with effects in it or without."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vehicle.identification.logs.schema import Array
from vehicle.model.ground import find_ground_index
from vehicle.model.tractor import (
    Implement,
    LogCorrections,
    Settings,
    Tractor,
    get_log_corrections,
    remove_log_corrections,
)
from vehicle.sim.calibration import build_steering_tables
from vehicle.sim.compile import build_ground_records, build_model_record


@dataclass(frozen=True, eq=False)
class ReplayRig:
    """A tractor ready for replay: its compiled model without effects, the ground, the steering table, and limits to
    where a discrepancy model was observed; one that is still being fitted has none."""

    tractor: Tractor
    model: Any
    ground: Any
    table: Array
    origin: tuple[float, float] = (0.0, 0.0)
    ranges: Mapping[str, float] = field(default_factory=dict)

    def build_effective_model(self, settings: Settings) -> Any:
        """Build the model record with effects; places in the field are moved to the origin of the dataset."""
        model = self.model.copy()
        fields = LogCorrections(settings, self.ranges).fields
        fields["affected"] = 1.0
        fields["patch_east"] -= self.origin[0]
        fields["patch_north"] -= self.origin[1]
        for name, value in fields.items():
            model[0][name] = value
        return model


def build_rig(tractor: Tractor, ground: str, origin: tuple[float, float]) -> ReplayRig:
    """Build the rig of a tractor without the effects learnt from logs; raises VehicleError for an unknown ground."""
    bare = remove_log_corrections(tractor)
    index = find_ground_index(ground)
    model = np.zeros(1, dtype=build_model_record(bare, Implement()).dtype)
    model[0] = build_model_record(bare, Implement())
    return ReplayRig(bare, model, build_ground_records()[index : index + 1], build_steering_tables(bare)[index], origin)


def build_rig_and_corrections(tractor: Tractor, ground: str, origin: tuple[float, float]) -> tuple[ReplayRig, Settings]:
    """Build the rig of a tractor, with the ranges of its discrepancy model, and return what its file has from logs."""
    learnt_effects = get_log_corrections(tractor)
    return replace(build_rig(tractor, ground, origin), ranges=learnt_effects.ranges), learnt_effects.settings
