"""The tractor: parameters, steering, tyres, guidance, speed control, missions, and the pymunk world that drives them.

    tractor, ground   frozen parameters, read from the files in `data`
    steering, tyres, guidance, speed   scalar formulas of the thesis, one place each
    plan_file         plans as text: format version, place of the metres, scenario
    chassis           forces on one tractor body
    missions          legs and gates: the program a tractor executes
    effects, rest     what logs can teach about a tractor; terms has their formulas
    learnt            what logs did teach about one tractor, and the tractor without it
    layout, compile   parameters and missions as arrays
    loop, engine      the compiled loop and its door to pymunk
    slow              the same loop in plain Python: oracle and fallback
    bodies, circles   a tractor as a pymunk body; circles at a fixed wheel angle
    calibration       the steering table made from such circles
    world             drives missions and hands back a run
    instruments       what antenna and heading show of a pose, for control and for logs
"""
