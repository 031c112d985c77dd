"""Readers of task logs, one module for each format."""
