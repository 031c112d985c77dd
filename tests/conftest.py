"""One thread for linear algebra on small matrices, and no time limit for a property.

Several threads only wait for each other on a busy machine, and the first example may have to compile the simulator.
With HEADLAND_TEST_SEED properties draw the same examples every time, and so fewer of them (tests.examples). Tests
started in the background of a shell would ignore interrupts, and so would their processes, some of which are
interrupted on purpose.

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

from tests.examples import SAME, count_examples
from tests.warm import warm

ROOT = Path(__file__).parents[1]

LONG = (
    "test_readme", "test_plan", "test_sandbox", "test_drawn_sets", "test_diagnose", "test_determinism",
    "test_pages_maps", "test_behind_proxy", "test_gate", "test_attack", "test_logs", "test_jobs", "test_commands",
    "test_executors", "test_entrance", "test_damaged", "test_pages", "test_mutations", "test_restarts",
    "test_installed", "test_pages_library", "test_jit", "test_refusals", "test_trials", "test_links",
    "test_accessibility", "test_overhang", "test_whole_field", "test_fences", "test_naming", "test_many",
    "test_database_lost", "test_golden_maps", "test_replanned_refills", "test_many_fields", "test_files",
    "test_control_centre_pages", "test_kernels", "test_backup", "test_day", "test_turning_kind", "test_slope",
    "test_pages_live", "test_third", "test_notebook_answers", "test_fair_queue", "test_diagnosis",
    "test_refused_fields", "test_pages_language", "test_service_stops", "test_outputs", "test_languages",
    "test_reader", "test_room", "test_formations", "test_invariance", "test_token_book", "test_innovations",
    "test_log_ground", "test_headland", "test_swapped_steering", "test_replanning", "test_access",
    "test_diagnosis_pages", "test_store", "test_robot", "test_parity", "test_solve", "test_asking",
    "test_selection", "test_field", "test_conventions", "test_connect", "test_typed_client", "test_incumbents",
)  # fmt: skip
"""Names of the slowest files, the slowest first; files that mostly wait come earlier."""

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
os.environ["HEADLAND_LANGUAGE"], os.environ["HEADLAND_UNITS"] = "en", "metric"  # whatever the machine speaks
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH", ""))))
FRESH_EXAMPLES = 100
"""Examples of a property that asks for no number, as Hypothesis has it."""
settings.register_profile("headland", deadline=None, derandomize=SAME, max_examples=count_examples(FRESH_EXAMPLES))
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
