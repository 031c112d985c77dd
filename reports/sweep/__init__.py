"""Sweeps: many combinations of options, estimated, as tables, pages and files."""
