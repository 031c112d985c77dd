"""Thousands of combinations of options at once: each estimated, the best of them shown, any of them driven in full."""
