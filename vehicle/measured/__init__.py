"""Measured logs of real drives, in storeys that know only those below them.

logs      what a log is: a file as columns (record, table, reading), rows that cannot be used (gating, motion), wrong
          units and signs recognised and fixed (conventions, conversions, bends, directions, gears), remarks
replay    logged commands through the functions of planning (course, replaying), the open-loop error over horizons
          (horizons, anchoring, windows), drives that nobody has made yet (drives)
surprise  what surprises in logs, given instruments and soil (noise, whitening, weights, bench), and what noise alone
          leaves (draws, floor)
fit       effects as coordinates (knobs), one solver for all fits (solver): of surprises (fitting) and of the open-loop
          error (openloop), and coordinates for data held out (heldout)
causes    one more effect (trial), where in the field (patches), errors without a name (dependence), what speaks for a
          cause (evidence), the choice (selection) and the fits it needs (refit)
mend      lowering the error of runs held out where no cause is known: what could (proposals), what does (mending), two
          grounds (levels), names all the same (irreplaceable); what is added (extension), the file made (extended)
answer    what is said: names, findings, notes, curves, nextdrive; verdict holds the result types, diagnose the order of
          the work, save the tractor file, demo made logs with a hidden effect

Every number that decides a verdict stands in thresholds.
"""
