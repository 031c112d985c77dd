"""Diagnoses and replays as tables, JSON, pictures and pages."""
