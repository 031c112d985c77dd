"""Memory layout shared by Python and compiled code: one record per model, tractor, leg and gate."""

from __future__ import annotations

import numpy as np

DT_S = 1.0 / 60.0  # one step: pymunk's customary 60 Hz, which 10 Hz control divides
GRAVITY_MPS2 = 9.80665  # standard gravity
HISTORY_STEPS = 96  # steps that delays can reach back: 1.6 s, above the longest dead time and latency of the catalogue


def _list_fields(names: str, kind: str = "f8") -> list[tuple[str, str]]:
    """Fields of one kind, by their names with spaces between."""
    return [(name, kind) for name in names.split()]


# Parameters that do not change during a run, per kind of tractor; SI and radians, distances from the centre of mass.
MODEL = np.dtype(
    [
        *_list_fields("mass inertia front rear track guide guide_reverse"),
        *_list_fields("lock dead_band switch rate lag gain latch"),
        *_list_fields("lateral_gain heading_gain lateral_limit lateral_ease wheel_pace lookahead_s"),
        *_list_fields("kp ki kd max_drive acceleration shift_time"),
        *_list_fields("nose tail half_width tool_front tool_tail tool_half_width reach"),
        # Load and terrain (vehicle.sim.load_terms); they count only where `loaded` is 1.
        *_list_fields("loaded draft_constant draft_linear draft_square axle_power brake_limit"),
        # Traction of the driven wheels (vehicle.energy.traction); a weight of 0 stands for wheels that do not slip.
        *_list_fields("driven_weight per_driven_weight envelope slip_resistance inverse_mobility"),
        *_list_fields("best_gain max_slip front_driven"),
        # Effects of vehicle.model.effects; they count only where `affected` is 1.
        *_list_fields("affected offset bend bend_left dead_steps half_play slide understeer slope_east slope_north"),
        *_list_fields("draft slip tool_slip speed_lag shift_forward shift_right latency heading_bias"),
        *_list_fields("position_late heading_late heading_filter"),
        # Of logs alone: guidance steers by what it gets, not by how that is stamped.
        *_list_fields("speed_scale position_clock heading_clock speed_clock steering_clock command_clock"),
        *_list_fields("patch patch_east patch_north patch_radius drift"),
        # Terms of vehicle.model.discrepancy_model; they count only where `discrepancy_model` is 1.
        *_list_fields("discrepancy_model discrepancy_slow discrepancy_fast discrepancy_left discrepancy_right"),
        *_list_fields("discrepancy_angle_by_speed discrepancy_angle_by_square"),
        *_list_fields("discrepancy_angle_to_east discrepancy_angle_to_north"),
        *_list_fields("discrepancy_grip_by_speed discrepancy_grip_by_angle discrepancy_grip_by_implement"),
        *_list_fields("discrepancy_grip_to_east discrepancy_grip_to_north"),
        *_list_fields("discrepancy_push_to_east discrepancy_push_to_north"),
    ]
)

# Side friction per radian of slip and rolling resistance, per ground. `shaped` is 0 for the plain tyres that plans
# are simulated with; otherwise the friction curve (slips in radians) and the grip of the driven wheels count too.
GROUND = np.dtype(
    _list_fields("front_slope front_limit rear_slope rear_limit rolling")
    + _list_fields("shaped peak_slip peak slide_slip slide grip ease")
)

# State per tractor. Velocities are in the body's frame: forward, to the right, clockwise.
STATE = np.dtype(
    [
        *_list_fields("x y angle forward steering command target_speed reference_speed integral last_error progress"),
        *_list_fields("lateral shift_left align_left stand_left done_time error_x error_y working"),
        # Memory of effects: steps since the start, wheel angle behind the play, and the last commands and poses.
        ("clock", "i8"),
        ("play", "f8"),
        *((name, "f8", (HISTORY_STEPS,)) for name in ("commands", "xs", "ys", "angles")),
        # Load and terrain: gradient of the ground below, thrust and slip of the driven wheels, seconds without getting
        # on, and the largest sideways push over weight with its place.
        *_list_fields("slope_east slope_north thrust wheel_slip short_time overturn overturn_x overturn_y"),
        *_list_fields("overturn_leg shortage stage segment leg status started done", "i8"),
        # Whether the tractor is off the field (before it enters or after it leaves), and whether it will leave.
        *_list_fields("away leaves", "i8"),
        *_list_fields("model first_leg last_leg error_key error_count", "i8"),
    ]
)

LEG = np.dtype(
    _list_fields("end speed lookahead gap stand")
    + _list_fields("gear implement ground first_segment last_segment first_gate last_gate leader leader_leg", "i8")
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
FINISHED, WORKING, TURNING, WAITING, REVERSING, STANDING = range(6)
