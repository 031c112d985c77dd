"""One thread for linear algebra on small matrices: several only wait for one another on a busy machine."""

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
