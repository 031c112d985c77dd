"""Logged commands replayed by the simulator, segment by segment, and the open-loop errors over horizons."""
