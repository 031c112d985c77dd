"""Memory layout shared by Python and compiled code: one record per ground, tractor, leg and gate.

That of a model is in vehicle.sim.compile, as the catalogue of effects names its fields.
"""

from __future__ import annotations

import numpy as np

DT_S = 1.0 / 60.0  # one step: pymunk's customary 60 Hz, which 10 Hz control divides
GRAVITY_MPS2 = 9.80665  # standard gravity
HISTORY_STEPS = 96  # steps that delays can reach back: 1.6 s, above the longest dead time and latency of the catalogue


def list_record_fields(names: str, kind: str = "f8") -> list[tuple[str, str]]:
    """Fields of one kind, by their names with spaces between."""
    return [(name, kind) for name in names.split()]


# Side friction per radian of slip and rolling resistance, per ground. `shaped` is 0 for the plain tyres that plans
# are simulated with; otherwise the friction curve (slips in radians) and the grip of the driven wheels count too.
GROUND = np.dtype(
    list_record_fields("front_slope front_limit rear_slope rear_limit rolling")
    + list_record_fields("shaped peak_slip peak slide_slip slide grip ease")
)

# State per tractor. Velocities are in the body's frame: forward, to the right, clockwise.
STATE = np.dtype(
    [
        *list_record_fields(
            "x y angle forward steering command target_speed reference_speed integral last_error progress"
        ),
        *list_record_fields("lateral shift_left align_left stand_left done_time error_x error_y working"),
        # Memory of effects: steps since the start, wheel angle behind the play, and the last commands and poses.
        ("clock", "i8"),
        ("play", "f8"),
        *((name, "f8", (HISTORY_STEPS,)) for name in ("commands", "xs", "ys", "angles")),
        # Load and terrain: gradient of the ground below, thrust and slip of the driven wheels, seconds without getting
        # on, and the largest sideways push over weight with its place.
        *list_record_fields("slope_east slope_north thrust wheel_slip short_time overturn overturn_x overturn_y"),
        *list_record_fields("overturn_leg shortage stage segment leg status started done", "i8"),
        # Whether the tractor is off the field (before it enters or after it leaves), and whether it will leave.
        *list_record_fields("away leaves", "i8"),
        *list_record_fields("model first_leg last_leg error_key error_count", "i8"),
    ]
)

LEG = np.dtype(
    list_record_fields("end speed lookahead gap stand")
    + list_record_fields(
        "gear implement ground first_segment last_segment first_gate last_gate leader leader_leg", "i8"
    )
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
