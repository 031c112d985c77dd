"""Measured logs: reading, unit and sign checks, sensor corrections and terrain."""
