"""The parameters of a tractor as compiled code reads them: one record per kind of tractor, constant during a run.

SI and radians, distances from the centre of mass.
"""

from __future__ import annotations

import numpy as np

from vehicle.model.effects import NEUTRAL_FIELDS
from vehicle.records import list_record_fields

MODEL = np.dtype(
    [
        *list_record_fields("mass inertia front rear track guide guide_reverse"),
        *list_record_fields("lock dead_band switch rate lag gain latch"),
        *list_record_fields("lateral_gain heading_gain lateral_limit lateral_ease wheel_pace lookahead_s"),
        *list_record_fields("kp ki kd max_drive acceleration shift_time"),
        *list_record_fields("nose tail half_width tool_front tool_tail tool_half_width reach"),
        # Load and terrain (vehicle.sim.load_terms); they count only where `loaded` is 1.
        *list_record_fields("loaded draft_constant draft_linear draft_square axle_power brake_limit"),
        # Traction of the driven wheels (vehicle.energy.traction); a weight of 0 stands for wheels that do not slip.
        *list_record_fields("driven_weight per_driven_weight envelope slip_resistance inverse_mobility"),
        *list_record_fields("best_gain max_slip front_driven"),
        # Effects and terms of a discrepancy model; they count only where `affected` and `discrepancy_model` are 1.
        *((name, "f8") for name in NEUTRAL_FIELDS),
    ]
)
