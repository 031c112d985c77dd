"""Formations: tractors that work side by side and turn one after the other."""
