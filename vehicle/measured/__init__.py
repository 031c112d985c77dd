"""Measured logs of real drives: reading, diagnosing, and what a diagnosis says. Storeys know those above them here.

logs: reading
    record, table          what a log is; a file as columns of numbers
    gating, stretches      which rows can be used and why not the others; which of them a replay can use
    motion                 what the positions alone say
    conventions            wrong units and signs, with conversions, bends, directions and gears: recognised and fixed
    constant, sensors      columns that stand still; instruments that contradict each other, set right in words
    levelling, tilt, grade the fall of the ground by a sensor of roll or pitch; across the way, and what speed it takes
    size                   whether logs can be of a tractor at all, and the size they suggest
    reading, remarks       the door: read_log, read_logs, log_from_frame; what a reader should know of a log

replay: comparing
    course, part           stretches on the simulation's grid; a balanced part of hours of them
    keeping, states        what was replayed once, so that nothing is driven twice; the columns of what is kept
    foretelling            what a measured speed tells of all steps before they are driven
    abreast                many stretches driven side by side
    replaying              logged commands through the functions of planning, and what instruments show of them
    anchoring, windows     rigid fits in closed form; the parts of a run that take turns
    horizons               open-loop error over horizons, anchored again piece by piece
    drives                 programmes a person can drive, and what a tractor would log on them

surprise: judging
    whitening              a Kalman filter that knows instruments and soil
    noise, weights         how rough the ground is; what each difference weighs
    bench                  one vector of surprises for a set of logs
    draws, floor           noise drawn as it is believed; the error that noise alone leaves

fit: explaining
    knobs                  effects and terms of the rest as coordinates
    products               of tall columns, on one core
    solver                 bounded Gauss-Newton with one-sided slopes, for every fit
    fitting, openloop      fits to the surprises, and to the open-loop error as one vector
    heldout                coordinates for data that had no part in finding them

causes: choosing
    trial, patches         one more effect and how far above chance it is; where in the field
    known, foreseen        what one scan of them tells for the next; what trials promise beside another fit
    dependence             what an error without a name depends on
    evidence, refit        what runs held out say, how sure a coordinate is; a fit with a part more or less
    challenge              every cause against its rivals once the model is settled
    selection              the choice: forward, backward, challenges

mend: lowering the error where no cause is known
    proposals, mending     what could lower it; what does, and stays
    levels, irreplaceable  runs on two grounds; effects that get a name all the same
    extension, extended    what is added to a tractor; the tractor file it makes

answer: saying
    case, names, likely    errors held out; which effects carry a name; which are likely without one
    whole                  what was found in a part of long logs, asked of all of them
    findings, notes        one finding per effect; sentences beside the answer
    nextdrive, curves      the drive that decides, the plot that shows a cause
    verdict, diagnose      the result types; the order of the work
    record                 how often what is called likely was right
    save, demo             the tractor file as text; made logs with a hidden effect

Every number that decides a verdict stands in thresholds.
"""
