"""Two runs that must be the same bit for bit."""

from vehicle.missions.run import SimulationRun


def assert_same_bits(run: SimulationRun, other: SimulationRun) -> None:
    """Assert that both runs are the same bit for bit."""
    assert run.outcome == other.outcome
    assert run.record.tobytes() == other.record.tobytes()
    assert run.time_s.tobytes() == other.time_s.tobytes()
    assert run.finish_s.tobytes() == other.finish_s.tobytes()
    assert (run.contacts, run.conflict) == (other.contacts, other.conflict)
    assert run.min_clearance_m == other.min_clearance_m
    assert (run.stall, run.roll_over) == (other.stall, other.roll_over)
