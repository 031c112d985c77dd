"""The experiments of the thesis: drives with fixed or changing steering and along test paths, and what they show."""
