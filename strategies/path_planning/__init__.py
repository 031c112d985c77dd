"""Drivable paths: primitives between two poses, turns, routes through a field, clearance of fences and obstacles."""
