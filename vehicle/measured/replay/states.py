"""What is kept of every step of a replay, before it is driven."""

X, Y, ANGLE, STEERING, FORWARD = range(5)  # columns: place (m) and angle (rad), wheel angle (rad), speed (m/s)
