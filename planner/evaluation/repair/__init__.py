"""Turns that a tractor does not follow well: found in a run, tried alone, and repaired."""
