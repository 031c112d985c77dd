"""Measured logs of real drives: reading, gating, and recognising wrong units and signs.

record       what a log is: columns, fixes, gated rows
table        a file as columns of numbers
gating       which rows can be used, and why not the others
motion       what the positions alone say about a drive
conventions  wrong units and signs: recognising and fixing them
logs         the door: read_log, read_logs, log_from_frame
"""
