"""What is shaped otherwise in every make of tractor: the steering, and the tyres on their ground."""

from vehicle.measured.causes.challenge import make_up


def test_steering_and_tyres_have_a_make_up_of_their_own() -> None:
    assert make_up("steering_rate") == make_up("steering_dead_time") != make_up("side_slip") == make_up("understeer")
    assert make_up("steering_offset") is None and make_up("wheel_slip") is None
