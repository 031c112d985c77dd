"""Task logs: import of as-driven data, comparison with a plan, and farm values learned from them."""
