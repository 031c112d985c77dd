"""Kinds of turns, as options offer them; imports nothing, so that help texts stay quick."""

TURN_KINDS = ("u", "omega", "switch-back")
