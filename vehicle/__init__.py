"""The tractor: parameters, steering, tyres, guidance, speed control, missions, and the pymunk world that drives them.

    tractor, ground   frozen parameters, read from the files in `data`
    faults            what is wrong with a parameter file, in a sentence
    datasheet         a whole tractor from what a maker's datasheet says
    steering, tyres, guidance, speed, gnss   scalar formulas of the thesis, one place each
    jit, series       the one setting with which they are compiled; tangents, sines and roots in vectors
    chassis, driveline   forces on one tractor body; from commands to wheel angle and drive force
    control           what a tractor decides ten times a second
    missions          legs and gates: the program a tractor executes
    plan_file         plans as text: format version, place of the metres, scenario
    effects, rest     what logs can teach about a tractor; terms has their formulas, kinds their coordinates for a fit
    learnt            what logs did teach about one tractor, and the tractor without it
    layout, compile   parameters and missions as arrays; joining makes paths of legs
    loop, engine, door   the compiled loop and its door to pymunk; memory finds where bodies keep their numbers
    slow              the same loop in plain Python: oracle and fallback
    bodies, circles   a tractor as a pymunk body; circles at a fixed wheel angle
    calibration       the steering table made from such circles
    world, run        drives missions and hands back a run
    rehearsal         plans of one fleet one after another, each from where it differs from the one before
    apart             tractors as each drives alone, and what a fleet drives, one from the other
    clearance         how close two tractors come
    approach          who comes too near to whom on ways foreseen
meetings          where on their ways two tractors cannot be at once
    instruments       what antenna and heading show of a pose, for control and for logs
    measured          from logs of a real tractor to what the simulation gets wrong
    twin              the virtual tractor of a real one, kept to it by what is measured; a simulated robot
    trials            the experiments of the thesis
"""
