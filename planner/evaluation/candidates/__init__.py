"""Candidates of a request: variants of their plans, lower bounds, pruning, simulation and figures."""
