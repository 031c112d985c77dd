"""The live twin of a tractor, predicted by the functions of the simulation and corrected by late and sparse fixes.

It says when the tractor differs from its file; a simulated robot tractor stands in for a real one. No network.
"""
