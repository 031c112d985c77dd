"""What is shaped otherwise in every make of tractor: the steering, and the tyres on their ground."""

from vehicle.identification.cause_selection.challenge import get_make_dependent_group


def test_steering_and_tyres_have_a_make_up_of_their_own() -> None:
    assert (
        get_make_dependent_group("steering_rate")
        == get_make_dependent_group("steering_dead_time")
        != get_make_dependent_group("side_slip")
        == get_make_dependent_group("understeer")
    )
    assert get_make_dependent_group("steering_offset") is None and get_make_dependent_group("wheel_slip") is None
