"""Candidates of a request: sketches of their plans, pruning, simulation and figures."""
