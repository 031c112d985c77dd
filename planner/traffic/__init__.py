"""Traffic of a fleet: trajectories, conflict zones, ways home for all, a timetable and its gates."""
