"""What each reference draws its cases from: kinds, programmes, rates, causes outside the catalogue, and faults.

The causes are described where they act: tests.truth.third_outside, fifth and fifth_outside.
"""

from tests.truth.cases import TruthCase
from tests.truth.drawing import Cause, Either, Menu, draw_cases

PLACE, TIME = ("place", "position", "north", "east", "field"), ("time", "day", "minute", "later", "run")
WAYS = ("bearing", "heading", "direction", "north", "east")
IMPLEMENT, SWING = ("implement", "work"), ("period", "swing", "every", "wave")
BEARING_DEG = (0.0, 360.0)
THIRD = Menu(
    stream=41,
    counts={"clean": 4, "effect": 9, "pair": 2, "closed_loop": 3, "column": 4, "law": 4, "fault": 4, "outside": 5,
            "odd_run": 2, "one_sided": 2, "one_speed": 2, "mixed": 1},
    programmes={"": ("three_speeds",), "clean": ("three_speeds", "mixed", "closed"), "closed_loop": ("closed",),
                "one_sided": ("one_sided",), "one_speed": ("one_speed", "ordered_angles"), "mixed": ("mixed",)},
    rates_hz=(5.0, 10.0, 10.0, 20.0),
    day_s=1400.0,
    outside={
        "oil_temperature": Cause({"lag_s": 0.6, "rate_share": 0.5, "warm_s": 350.0}, TIME,
                                 ("steering_lag", "steering_rate", "steering_dead_time")),
        "tyre_pressure_loss": Cause({"run": (2.0, 4.99), "per_minute": (0.8, 1.2)}, TIME),
        "crosswind": Cause({"mps2": (0.5, 0.9), "bearing_deg": BEARING_DEG}, WAYS, ("cross_slope_drift",)),
        "gravity_slope": Cause({"mps2": (0.5, 0.9), "bearing_deg": BEARING_DEG}, WAYS, ("cross_slope_drift",)),
        "speed_linkage": Cause({"deg_per_mps": (1.0, 1.5)}, ("speed",)),
        "implement_push": Cause({"side_n": (2000.0, 3000.0)}, IMPLEMENT, ("implement_side_draft",)),
        "wheel_wobble": Cause({"angle_deg": (1.5, 2.2), "length_m": (2.0, 4.0)}, SWING),
        "hitch_swing": Cause({"side_n": (4000.0, 7000.0)}, (*SWING, "implement", "bend")),
        "differential_lock": Cause({"share": 1.0, "from_s": 20.0}, ("time", "angle", "bend", "later")),
        "moist_soil": Cause({"share": (0.15, 0.25), "east_m": Either(5.0, 10.0), "north_m": Either(5.0, 10.0),
                             "radius_m": 14.0}, PLACE, ("grip_patch",)),
        "steering_stiction": Cause({"angle_deg": (1.2, 1.8)}, ("steering", "command", "small"),
                                   ("steering_deadband", "steering_backlash")),
        "trees": Cause({"size_m": (0.5, 0.9), "east_m": (-4.0, 4.0), "width_m": 5.0}, (*PLACE, "receiver")),
        "brisk_start": Cause({"mps2": (1.3, 1.8)}, ("start", "speed")),
        "soft_front_tyres": Cause({"share": (0.22, 0.27)}, ("lateral", "speed", "bend"), ("understeer",)),
        "articulated": Cause({"joint": (0.4, 0.6), "antenna_forward_m": (-0.8, 0.2)},
                             ("steering", "rate", "antenna", "articulated")),
        "mast_sway": Cause({"m_per_mps2": (0.25, 0.4)}, ("antenna", "position", "lateral")),
        "governor_hunting": Cause({"share": (0.06, 0.1), "period_s": (3.0, 5.0)}, ("speed", "period")),
    },
    fault_runs={
        "loose": ("mixed", (2, 4)), "torn": ("three_speeds", (2, 3, 4)), "stuck": ("three_speeds", (0, 1, 2, 3, 4)),
        "wanders": ("three_speeds", tuple(range(8))), "jumps": ("mixed", tuple(range(8))),
        "position_frozen": ("mixed", tuple(range(8))), "heading_frozen": ("three_speeds", (2, 3, 4)),
        "speed_frozen": ("three_speeds", tuple(range(8))), "wheel_sensor_frozen": ("mixed", (2, 4)),
    },
    bend_runs=(2, 3, 4),
)  # fmt: skip
FIFTH = Menu(
    stream=57,
    counts={"clean": 4, "effect": 9, "faint": 2, "pair": 3, "closed_loop": 2, "column": 3, "law": 4, "fault": 4,
            "outside": 7, "odd_run": 1, "one_sided": 2, "one_speed": 2, "mixed": 1},
    programmes={"": ("both",), "clean": ("both", "field", "yard"), "closed_loop": ("field",),
                "one_sided": ("right_only",), "one_speed": ("one_speed",)},
    rates_hz=(4.0, 8.0, 10.0, 12.5, 25.0),
    outside={
        "weight_shift": Cause({"share": (1.2, 1.9)}, IMPLEMENT, ("understeer", "steering_gain")),
        "tyre_leak": Cause({"per_minute": (0.008, 0.012)}, TIME, ("steering_offset",)),
        "axle_lock": Cause({"from_s": (5.0, 20.0)}, ("bend", "angle", "time", "turn")),
        "crab_axle": Cause({"run": (2.0, 6.99), "angle_deg": (0.8, 1.5)}, ("run", "unlike")),
        "boom_wind": Cause({"moment_nm": (2500.0, 4000.0), "bearing_deg": BEARING_DEG}, (*IMPLEMENT, *WAYS)),
        "furrow_walls": Cause({"side_n": (3000.0, 4500.0)}, (*IMPLEMENT, *PLACE)),
        "weak_pump": Cause({"deg_per_s": (9.0, 13.0)}, ("speed", "steering"), ("steering_rate", "steering_lag")),
        "leaky_valve": Cause({"per_s": (0.15, 0.3)}, ("steering", "wheel", "angle"),
                             ("steering_deadband", "steering_lag")),
        "pushed_tank": Cause({"mass_kg": (2500.0, 3500.0)}, ("speed", "start", "acceleration", "bend", "angle"),
                             ("speed_lag",)),
        "soft_springs": Cause({"ratio": (4.0, 6.0)}, ("lateral", "antenna", "position", "turn", "place")),
        "gyro_scale": Cause({"share": (0.015, 0.03), "hold_s": (30.0, 60.0)}, ("heading", "turn", "bend")),
        "wheel_hysteresis": Cause({"angle_deg": (1.2, 2.2)}, ("steering", "wheel"), ("steering_backlash",)),
        "mast_spring": Cause({"hertz": (0.5, 0.8), "damping": (0.04, 0.1)}, ("antenna", "position", *SWING)),
        "roll_lever": Cause({"height_m": (4.0, 7.0)}, ("antenna", "position", "lateral", "place")),
        "magnet": Cause({"size_deg": (-9.0, -5.0), "east_m": (-12.0, 12.0), "north_m": (-12.0, 12.0),
                         "radius_m": (8.0, 14.0)}, ("heading", "place")),
        "kalman_lag": Cause({"way_m": (0.4, 0.7)}, ("position", "speed"), ("position_delay", "clock_offset_position")),
        "grid_scale": Cause({"east": (1.02, 1.04)}, (*PLACE, *WAYS)),
        "baseline_flex": Cause({"share": (1.0, 2.0)}, ("heading", "lateral")),
        # Rims that slip under draft come with the slip that they hide.
        "rim_speed": Cause({"here": 1.0}, ("speed",), beside={"implement_slip": {"ratio": (0.05, 0.09)}}),
        "stamp_jitter": Cause({"time_s": (0.05, 0.09)}, ("time", "clock", "stamp"), rate_hz=8.0),
        # In reverse a course is no heading, and is refused.
        "course_heading": Cause({"here": 1.0}, ("heading",), ("heading_delay", "heading_filter"), programme="yard"),
    },
    fault_runs={
        "loose": ("both", (6, 8)), "stuck": ("both", (4, 5, 6)), "wanders": ("both", (0, 1, 4, 5, 6)),
        "jumps": ("both", (4, 5, 6, 7)), "position_frozen": ("both", (4, 5, 6, 7)),
        "heading_frozen": ("both", (4, 5, 6)), "speed_frozen": ("both", (4, 5, 6)),
        "wheel_sensor_frozen": ("both", (6, 8)),
    },
    bend_runs=(4, 5, 6),
)  # fmt: skip
MENUS = {"third": THIRD, "fifth": FIFTH}


def draw_reference(name: str, seed: int) -> list[TruthCase]:
    """The cases of a seed by one of MENUS."""
    return draw_cases(MENUS[name], seed)
