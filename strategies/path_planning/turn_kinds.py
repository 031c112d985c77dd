"""Kinds of turns and corners, and when the headland is worked, as options offer them; quick, as it imports nothing."""

TURN_KINDS = ("u", "omega", "switch-back")

AUTO_CORNERS, SQUARE_CORNERS, ROUND_CORNERS = CORNERS = "auto", "square", "round"
"""How headland passes turn at corners: worked whole, in an arc, or each as is quicker."""

HEADLAND_FIRST, HEADLAND_LAST = HEADLAND_ORDERS = "first", "last"
