"""Logged commands through the functions of planning, on the simulation's own time grid."""
