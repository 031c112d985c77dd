"""Traffic of a fleet: trajectories, conflict zones, a timetable without deadlocks, repair of remaining conflicts."""
