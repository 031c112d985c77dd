"""The experiments of the thesis: drives with fixed or changing steering and along test paths, and what they show.

loop         the compiled loop: drive_tractor as in plans, every step recorded
drive        drives with given steering, on tyres of chapter 4 or the corrected base model; along a path
oversteer    the one criterion of stability
paths        the paths of the experiments
errors       distances between tracks, errors along a path
thesis       the numbers the thesis prints
"""
