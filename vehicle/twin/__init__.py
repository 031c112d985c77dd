"""The live twin of a tractor: predicted by the world's own functions, corrected by what is measured, without a network.

motion        a tractor moved step by step without a pymunk space; noise, hidden effects
stepper       a simulated robot tractor in real time: legs as they are released, or remote commands
twin          the virtual tractor of a real one: fed with commands, corrected by late and sparse fixes
ways          the two ways of correction: the thesis's, and prediction over a fix's age
rolling       the tractor rolled along held commands, with what was learnt of it on the way
belief        a Kalman filter over pose, turn and slip, and how surprising each fix is
leaps         fixes that are suddenly elsewhere, which say nothing of the tractor
doubt         the sequential test that says when a twin is wrong
record        a run as a log in the project's columns
cause         from the recorded log to the cause, and to the amended tractor
"""
