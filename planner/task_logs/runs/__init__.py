"""Imported runs: records, phases, worked ground and their files."""
