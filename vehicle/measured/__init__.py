"""Measured logs of real drives: reading, diagnosing, and what a diagnosis says. Every storey knows only those above it.

logs: reading
    record, table          what a log is; a file as columns of numbers
    gating, stretches      which rows can be used and why not the others; which of them a replay can use
    motion                 what the positions alone say
    conventions            wrong units and signs, with conversions, bends, directions and gears: recognised and fixed
    reading, remarks       the door: read_log, read_logs, log_from_frame; what a reader should know of a log

replay: comparing
    course                 stretches on the simulation's grid
    replaying              logged commands through the functions of planning, and what instruments show of them
    anchoring, windows     rigid fits in closed form; the parts of a run that take turns
    horizons               open-loop error over horizons, anchored again piece by piece
    drives                 programmes a person can drive, and what a tractor would log on them

surprise: judging
    whitening              a Kalman filter that knows instruments and soil
    noise, weights         how rough the ground is; what each difference weighs
    bench                  one vector of surprises for a set of logs
    draws, floor           noise drawn as it is believed; the error that noise alone leaves

fit, causes, mend, answer: explaining
    knobs, fitting         effects as coordinates; fits to the surprises
    openloop, heldout      the open-loop error as one vector; coordinates for data held out
    naming, patches, dependence  which effects the logs speak for, where, and what is left without a name
    mending, extension     lowering the error where no cause is known; what is added to the tractor
    findings, verdict, diagnose  one finding per effect, and the answer
    nextdrive, curves      the drive that decides, the plot that shows it
    save, demo             the tractor file; made logs with a hidden effect
"""
