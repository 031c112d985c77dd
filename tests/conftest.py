"""One thread for linear algebra on small matrices, and no time limit for a property.

Several threads only wait for one another on a busy machine, and the first example may have to compile the simulator.
With HEADLAND_TEST_SEED properties draw the same examples every time. Started in the background of a shell, tests would
ignore interrupts, and so would all that they start: some of them interrupt and wait for the end.

Files are handed out whole, the long ones first, so that no worker is left with one of them at the end; a worker more
than there are processors works while the tests of the service wait.
"""

import os
import signal
import threading

import pytest
from hypothesis import settings

LONG = (
    "test_readme", "test_naming", "test_determinism", "test_plan", "test_jobs", "test_trials", "test_invariance",
    "test_conventions", "test_tours", "test_jit", "test_whole_field", "test_logs", "test_pool", "test_low_rates",
    "test_mending", "test_replanning", "test_commands", "test_pages",
    "test_pages_live", "test_diagnose",
)  # fmt: skip
"""Names of the files that take longest, the longest first."""

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
settings.register_profile("headland", deadline=None, derandomize="HEADLAND_TEST_SEED" in os.environ)
settings.load_profile("headland")
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Workers of `-n auto`."""
    return (os.cpu_count() or 1) + 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first; the order of the others stays."""
    order = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: order.get(item.path.stem, len(LONG)))
