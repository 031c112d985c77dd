"""Programmes: which tractor works which lines, in which order and direction, and which lines are left."""
