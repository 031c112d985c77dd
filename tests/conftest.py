"""One thread for linear algebra on small matrices, and no time limit for a property.

Several threads only wait for one another on a busy machine, and the first example may have to compile the simulator.
With HEADLAND_TEST_SEED properties draw the same examples every time. Started in the background of a shell, tests would
ignore interrupts, and so would all that they start: some of them interrupt and wait for the end.
"""

import os
import signal
import threading

from hypothesis import settings

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
settings.register_profile("headland", deadline=None, derandomize="HEADLAND_TEST_SEED" in os.environ)
settings.load_profile("headland")
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)
