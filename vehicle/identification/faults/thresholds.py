"""The numbers that decide on faults of the steering, and their sources."""

# Chosen, deg: beyond what the slowest steering of the catalogue allows; an offset, a dead band and play are less.
FAULT_TOLERANCE_DEG = 2.5
# Chosen, standard deviations of the angle that the path needs, in addition.
FAULT_NEEDED_SIGMAS = 2.0
# Chosen, shares of an angle that a path may need: a patch without grip leaves half, no cause doubles it.
FAULT_SHARE_LEFT, FAULT_SHARE_MORE = 0.4, 1.7
# Chosen, m/s2: a path that still turns with this lateral acceleration may be that of sliding tyres.
FAULT_SLIDING_MPS2 = 0.3
# Chosen, s: time beyond the limit that makes a fault, and time between two parts of one fault.
FAULT_LEAST_S, FAULT_JOIN_S = 2.0, 12.0
