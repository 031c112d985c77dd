"""Memory layout shared by Python and compiled code: one record per model, tractor, leg and gate."""

from __future__ import annotations

import numpy as np

DT_S = 1.0 / 60.0  # one step: pymunk's customary 60 Hz, which 10 Hz control divides
GRAVITY_MPS2 = 9.80665  # standard gravity
HISTORY_STEPS = 96  # steps that delays can reach back: 1.6 s, above the longest dead time and latency of the catalogue

# Parameters that do not change during a run, per kind of tractor; SI and radians, distances from the centre of mass.
MODEL = np.dtype(
    [
        ("mass", "f8"),
        ("inertia", "f8"),
        ("front", "f8"),
        ("rear", "f8"),
        ("track", "f8"),
        ("guide", "f8"),
        ("guide_reverse", "f8"),
        ("lock", "f8"),
        ("dead_band", "f8"),
        ("switch", "f8"),
        ("rate", "f8"),
        ("lag", "f8"),
        ("gain", "f8"),
        ("latch", "f8"),
        ("lateral_gain", "f8"),
        ("heading_gain", "f8"),
        ("lateral_limit", "f8"),
        ("lateral_ease", "f8"),
        ("wheel_pace", "f8"),
        ("lookahead_s", "f8"),
        ("kp", "f8"),
        ("ki", "f8"),
        ("kd", "f8"),
        ("max_drive", "f8"),
        ("acceleration", "f8"),
        ("shift_time", "f8"),
        ("nose", "f8"),
        ("tail", "f8"),
        ("half_width", "f8"),
        ("tool_front", "f8"),
        ("tool_tail", "f8"),
        ("tool_half_width", "f8"),
        ("reach", "f8"),
        # Load and terrain (vehicle.sim.load_terms); they count only where `loaded` is 1.
        ("loaded", "f8"),
        ("draft_constant", "f8"),
        ("draft_linear", "f8"),
        ("draft_square", "f8"),
        ("axle_power", "f8"),
        ("brake_limit", "f8"),
        # Traction of the driven wheels (vehicle.energy.traction); a weight of 0 stands for wheels that do not slip.
        ("driven_weight", "f8"),
        ("per_driven_weight", "f8"),
        ("envelope", "f8"),
        ("slip_resistance", "f8"),
        ("inverse_mobility", "f8"),
        ("best_gain", "f8"),
        ("max_slip", "f8"),
        ("front_driven", "f8"),
        # Effects of vehicle.model.effects; they count only where `affected` is 1.
        ("affected", "f8"),
        ("offset", "f8"),
        ("bend", "f8"),
        ("bend_left", "f8"),
        ("dead_steps", "f8"),
        ("half_play", "f8"),
        ("slide", "f8"),
        ("understeer", "f8"),
        ("slope_east", "f8"),
        ("slope_north", "f8"),
        ("draft", "f8"),
        ("slip", "f8"),
        ("tool_slip", "f8"),
        ("speed_lag", "f8"),
        ("shift_forward", "f8"),
        ("shift_right", "f8"),
        ("latency", "f8"),
        ("heading_bias", "f8"),
        ("position_late", "f8"),
        ("heading_late", "f8"),
        ("heading_filter", "f8"),
        # Of logs alone: guidance steers by what it gets, not by how that is stamped.
        ("speed_scale", "f8"),
        ("position_clock", "f8"),
        ("heading_clock", "f8"),
        ("speed_clock", "f8"),
        ("steering_clock", "f8"),
        ("command_clock", "f8"),
        ("patch", "f8"),
        ("patch_east", "f8"),
        ("patch_north", "f8"),
        ("patch_radius", "f8"),
        ("drift", "f8"),
        # Terms of vehicle.model.discrepancy_model; they count only where `discrepancy_model` is 1.
        ("discrepancy_model", "f8"),
        ("discrepancy_slow", "f8"),
        ("discrepancy_fast", "f8"),
        ("discrepancy_left", "f8"),
        ("discrepancy_right", "f8"),
        ("discrepancy_angle_by_speed", "f8"),
        ("discrepancy_angle_by_square", "f8"),
        ("discrepancy_angle_to_east", "f8"),
        ("discrepancy_angle_to_north", "f8"),
        ("discrepancy_grip_by_speed", "f8"),
        ("discrepancy_grip_by_angle", "f8"),
        ("discrepancy_grip_by_implement", "f8"),
        ("discrepancy_grip_to_east", "f8"),
        ("discrepancy_grip_to_north", "f8"),
        ("discrepancy_push_to_east", "f8"),
        ("discrepancy_push_to_north", "f8"),
    ]
)

# Side friction per radian of slip and rolling resistance, per ground. `shaped` is 0 for the plain tyres that plans
# are simulated with; otherwise the friction curve (slips in radians) and the grip of the driven wheels count too.
GROUND = np.dtype(
    [
        ("front_slope", "f8"),
        ("front_limit", "f8"),
        ("rear_slope", "f8"),
        ("rear_limit", "f8"),
        ("rolling", "f8"),
        ("shaped", "f8"),
        ("peak_slip", "f8"),
        ("peak", "f8"),
        ("slide_slip", "f8"),
        ("slide", "f8"),
        ("grip", "f8"),
        ("ease", "f8"),
    ]
)

# State per tractor. Velocities are in the body's frame: forward, to the right, clockwise.
STATE = np.dtype(
    [
        ("x", "f8"),
        ("y", "f8"),
        ("angle", "f8"),
        ("forward", "f8"),
        ("steering", "f8"),
        ("command", "f8"),
        ("target_speed", "f8"),
        ("reference_speed", "f8"),
        ("integral", "f8"),
        ("last_error", "f8"),
        ("progress", "f8"),
        ("lateral", "f8"),
        ("shift_left", "f8"),
        ("align_left", "f8"),
        ("stand_left", "f8"),
        ("done_time", "f8"),
        ("error_x", "f8"),
        ("error_y", "f8"),
        ("working", "f8"),
        # Memory of effects: steps since the start, wheel angle behind the play, and the last commands and poses.
        ("clock", "i8"),
        ("play", "f8"),
        ("commands", "f8", (HISTORY_STEPS,)),
        ("xs", "f8", (HISTORY_STEPS,)),
        ("ys", "f8", (HISTORY_STEPS,)),
        ("angles", "f8", (HISTORY_STEPS,)),
        # Load and terrain: gradient of the ground below, thrust and slip of the driven wheels, seconds without getting
        # on, and the largest sideways push over weight with its place.
        ("slope_east", "f8"),
        ("slope_north", "f8"),
        ("thrust", "f8"),
        ("wheel_slip", "f8"),
        ("short_time", "f8"),
        ("overturn", "f8"),
        ("overturn_x", "f8"),
        ("overturn_y", "f8"),
        ("overturn_leg", "i8"),
        ("shortage", "i8"),
        ("stage", "i8"),
        ("segment", "i8"),
        ("leg", "i8"),
        ("status", "i8"),
        ("started", "i8"),
        ("done", "i8"),
        # Whether the tractor is off the field (before it enters or after it leaves), and whether it will leave.
        ("away", "i8"),
        ("leaves", "i8"),
        ("model", "i8"),
        ("first_leg", "i8"),
        ("last_leg", "i8"),
        ("error_key", "i8"),
        ("error_count", "i8"),
    ]
)

LEG = np.dtype(
    [
        ("end", "f8"),
        ("speed", "f8"),
        ("lookahead", "f8"),
        ("gap", "f8"),
        ("stand", "f8"),
        ("gear", "i8"),
        ("implement", "i8"),
        ("ground", "i8"),
        ("first_segment", "i8"),
        ("last_segment", "i8"),
        ("first_gate", "i8"),
        ("last_gate", "i8"),
        ("leader", "i8"),
        ("leader_leg", "i8"),
    ]
)

GATE = np.dtype([("tractor", "i8"), ("progress", "f8")])

# Columns of the 10 Hz record, and their positions; REC_POSE is x, y and angle, REC_PLACE the first two.
RECORD_COLUMNS = ("x", "y", "angle", "steering_rad", "speed_mps", "leg", "status")
REC_X, REC_Y, REC_ANGLE, REC_STEERING, REC_SPEED, REC_LEG, REC_STATUS = range(len(RECORD_COLUMNS))
REC_PLACE, REC_POSE = slice(REC_X, REC_ANGLE), slice(REC_X, REC_STEERING)
# Columns of a body as pymunk reads it in batch: place, mathematical angle, velocity, spin (counter-clockwise).
BODY_COLUMNS = ("x", "y", "angle", "vx", "vy", "spin")
BODY_X, BODY_Y, BODY_ANGLE, BODY_VX, BODY_VY, BODY_SPIN = range(len(BODY_COLUMNS))
BODY_WIDTH, BODY_PLACE, BODY_VELOCITY = len(BODY_COLUMNS), slice(BODY_X, BODY_ANGLE), slice(BODY_VX, BODY_SPIN)
WORKING, TURNING, WAITING, REVERSING, STANDING, FINISHED = 1, 2, 3, 4, 5, 0
