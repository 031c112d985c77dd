"""Compiles every function of planner/pipeline/kernels.csv into vehicle/kernels, from where a wheel carries it.

Run by `.ci/release` with NUMBA_CPU_NAME=generic, so that the code runs on every processor of this family.
"""

import os

from planner.pipeline.kernels import compile_share, parse_types, read_kernels
from vehicle.jit import SHIPPED, ship_overload

model = os.environ.get("NUMBA_CPU_NAME")
if model != "generic":
    raise SystemExit(f"NUMBA_CPU_NAME is {model}; set it to generic, so that other processors can run the code.")
kernels = read_kernels()
compile_share(kernels)
for kernel in kernels:
    ship_overload(kernel.find_dispatcher(), parse_types(kernel.arguments))
print(f"{len(kernels)} kernels in {SHIPPED}")
