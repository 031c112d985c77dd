"""The day as an optimisation problem, its solvers and lower bounds."""
