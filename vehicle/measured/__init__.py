"""Measured logs of real drives: reading, diagnosing, and what a diagnosis says.

Reading
record, table          what a log is; a file as columns of numbers
gating, motion         which rows can be used and why not the others; what the positions alone say
conventions            wrong units and signs, with conversions, bends, directions and gears: recognised and fixed
logs, remarks          the door: read_log, read_logs, log_from_frame; what a reader should know of a log

Comparing
course, replay         stretches on the simulation's grid; logged commands through the functions of planning
horizons, anchoring    open-loop error over horizons, anchored again piece by piece
whitening, noise, bench  what surprises in the logs, given instruments and soil
openloop               the open-loop error as one vector

Explaining
knobs, fitting         effects as coordinates; fits to the surprises
naming, patches, dependence  which effects the logs speak for, where, and what is left without a name
mending, heldout       lowering the error on runs held out where no cause is known
extension, findings    what is added to the tractor; one finding per effect
nextdrive, curves, verdict, diagnose  the drive that decides, the plot that shows it, the answer
save, demo             the tractor file; made logs with a hidden effect
"""
