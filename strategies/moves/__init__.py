"""Moves between work lines: found with the machine's body in the search, and driven once in the simulator."""
