"""Work that was driven: read from the files of machines, measured, compared with plans, and learnt from.

record, metres      a run as its file has it; the same in metres, with course and speed
forms, reading      files of machines, one module a form; which form a file has
phases, summary     what was done when; a run in figures
files, importing    runs as files, written and read; from machines' files to them
ground, comparing   what was worked, again and not at all; a plan and what was driven of it
observing, estimates   events of runs to learn from; values of them with intervals
turning, learning, toml_edit   turn speeds from turn times; what goes into the farm file, and how
example             task data of a saved plan, with a known truth
"""
