"""Lowering the error on runs held out, and what is added to a tractor."""
