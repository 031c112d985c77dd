"""The live twin of a tractor: predicted by the world's own functions, corrected by what is measured, without a network.

motion        a tractor moved step by step without a pymunk space; noise, hidden effects
stepper       a simulated robot tractor in real time: legs as they are released, or remote commands
"""
