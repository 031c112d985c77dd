"""The tractor: parameters, steering, tyres, guidance, speed control, missions, and the pymunk world that drives them.

    tractor, ground   frozen parameters, read from the files in `data`
    steering, tyres, guidance, speed   scalar formulas of the thesis, one place each
    plan_file         plans as text: format version, place of the metres, scenario
    chassis           forces on one tractor body
    missions          legs and gates: the program a tractor executes
    compile           missions as arrays
    loop, engine      the compiled loop and its door to pymunk
    slow              the same loop in plain Python: oracle and fallback
    world             drives missions and hands back a run
    calibration       circles, and the steering table made from them
"""
