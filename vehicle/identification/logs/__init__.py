"""Measured logs: reading, unit and sign checks, sensor corrections, terrain and size of the vehicle."""
