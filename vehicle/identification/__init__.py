"""System identification from measured logs: what a simulated tractor gets wrong, why, and the extended tractor file.

Layers, each knowing only those before it: logs, faults, replay, diagnosis.
"""
