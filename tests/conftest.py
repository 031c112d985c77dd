"""One thread for linear algebra on small matrices, and no time limit for a property.

Several threads only wait for each other on a busy machine, and the first example may have to compile the simulator.
With HEADLAND_TEST_SEED properties draw the same examples every time, and so fewer of them: what is drawn again in every
run of CI finds nothing new. Tests started in the background of a shell would ignore interrupts, and so would their
processes, some of which are interrupted on purpose.

Files are handed out whole, the long ones first, so that no worker is left with one of them at the end; one worker more
than processors works while tests of the service wait. All processes use the sources of this folder, even if the package
is installed as well, so that they share one compiled simulator; before the whole suite starts on several workers it is
compiled once.
"""

import gc
import os
import signal
import threading
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from tests.warm import warm

ROOT = Path(__file__).parents[1]

LONG = (
    "test_readme", "test_determinism", "test_attack", "test_commands", "test_jobs", "test_invariance", "test_damaged",
    "test_plan", "test_conventions", "test_whole_field", "test_slope", "test_naming", "test_restarts",
    "test_replanning", "test_logs", "test_executors", "test_pages", "test_golden_maps", "test_second_reference",
    "test_many", "test_many_fields", "test_jit", "test_replanned_refills", "test_contract", "test_trials", "test_day",
    "test_formations", "test_refusals", "test_mending", "test_outputs", "test_headland", "test_service_stops",
    "test_files", "test_browser", "test_fuzz_logs", "test_layout", "test_learning", "test_solve", "test_fences",
    "test_grip_patches", "test_access", "test_study", "test_long_logs", "test_pages_live", "test_page", "test_reverse",
    "test_asking", "test_field", "test_entrance",
)  # fmt: skip
"""Names of the slowest files, the slowest first; files that mostly wait come earlier."""

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
os.environ["HEADLAND_LANGUAGE"], os.environ["HEADLAND_UNITS"] = "en", "metric"  # whatever the machine speaks
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH", ""))))
SAME_EXAMPLES, FRESH_EXAMPLES = 40, 100
"""Examples of a property that asks for no number; chosen, the second as Hypothesis does."""
_same = "HEADLAND_TEST_SEED" in os.environ
settings.register_profile(
    "headland", deadline=None, derandomize=_same, max_examples=SAME_EXAMPLES if _same else FRESH_EXAMPLES
)
settings.load_profile("headland")
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Workers of `-n auto`."""
    return (os.cpu_count() or 1) + 1


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile before workers start, in the process that starts them."""
    config = session.config
    whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    if whole and config.getoption("numprocesses", None) and not hasattr(config, "workerinput"):
        warm()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, Any, Any]:
    """Collect without garbage collection: there is little garbage, as imports stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first, then those with slow tests; the order of the others stays."""
    order = {name: place for place, name in enumerate(LONG)}
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: order.get(item.path.stem, len(LONG) + (item.path not in slow)))
