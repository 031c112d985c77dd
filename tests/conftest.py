"""One thread for linear algebra on small matrices, and one profile for all properties.

Several threads only wait for each other on a busy machine, and the first example may have to compile the simulator.
Whether `CI` is set or not, properties draw the same examples (tests.examples). Tests started in the background of a
shell would ignore interrupts, and so would their processes, some of which are interrupted on purpose.

A worker that has nothing left takes half of what the busiest still has; two workers more than processors work while
tests of the service wait. All processes use the sources of this folder, even if the package is installed as well, so
that they share one compiled simulator; before the whole suite starts on several workers it is compiled once.
"""

import gc
import os
import signal
import sys
import threading
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

from tests.examples import DRAWS_FRESH, count_examples
from tests.warm import warm

if TYPE_CHECKING:
    from playwright.sync_api import Browser

ROOT = Path(__file__).parents[1]
ALIAS = ROOT / "planner" / "cli" / "alias"

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
os.environ["HEADLAND_LANGUAGE"], os.environ["HEADLAND_UNITS"] = "en", "metric"  # whatever the machine speaks
sys.path.insert(0, str(ALIAS))
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(ROOT), str(ALIAS), os.environ.get("PYTHONPATH", ""))))
settings.register_profile(
    "headland", deadline=None, database=None, derandomize=not DRAWS_FRESH, max_examples=count_examples(100),
    suppress_health_check=[HealthCheck.too_slow],
)  # fmt: skip
settings.load_profile("headland")
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Workers of `-n auto`."""
    return (os.cpu_count() or 1) + 2


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


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests come first: at the end, workers that have nothing left would wait for one of them."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    """A real browser without a window; where none is installed, and none must be, the test is skipped."""
    from tests.browsers import BROWSER, open_browser

    if BROWSER is None and not os.environ.get("HEADLAND_TEST_BROWSER"):
        pytest.skip("no browser is installed")
    with open_browser() as found:
        yield found


@pytest.fixture(scope="module")
def first_layout() -> Iterator[None]:
    """Of several layouts the most promising is taken, without timing them: for tests whose matter is another."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("planner.evaluation.preparation.choose_quickest_index", lambda *_: 0)
        yield
