"""Kinds of turns and of corners, as options offer them; imports nothing, so that help texts stay quick."""

TURN_KINDS = ("u", "omega", "switch-back")

AUTO_CORNERS, SQUARE_CORNERS, ROUND_CORNERS = CORNERS = "auto", "square", "round"
"""How headland passes turn at corners: worked whole, in an arc, or each as is quicker."""
