"""The tractor: its parameters, the pymunk simulation that drives it, and what measured logs add to both.

The modules beside this one are the base: errors, record layouts, compilation and fast functions. Packages, each of
which imports only those before it: model, control and missions, sim, datasheet, identification, twin, trials.
"""
