"""One thread for linear algebra on small matrices, and no time limit for a property.

Several threads only wait for one another on a busy machine, and the first example may have to compile the simulator.
With HEADLAND_TEST_SEED properties draw the same examples every time.
"""

import os

from hypothesis import settings

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
settings.register_profile("headland", deadline=None, derandomize="HEADLAND_TEST_SEED" in os.environ)
settings.load_profile("headland")
