"""Formats of field files and of guidance files, one module each, with what they share."""
