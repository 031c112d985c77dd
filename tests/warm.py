"""The simulator compiled once, before tests start that would each compile it at the same time.

Two processes share the work: one plans a field with every strategy, one has twins and trials and diagnoses logs.
Neither starts others, which would compile the same again. Where all is compiled already they take some seconds.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile

LONGEST_S = 600.0
PLANS = """
import sys
from planner.main import main
words = "plan netherlands --width 6 --tractors 1-2 --all --processes 1 --json"
sys.argv = ["headland", *words.split()]
main()
"""
DRIVES = """
import sys
from pathlib import Path
from planner.main import main
from tests.truth.model import make_logs
here = Path.cwd()
for number, log in enumerate(make_logs({"steering_offset": {"angle_deg": 1.0}}, seed=3)[:8]):
    log.to_csv(here / f"{number}.csv", index=False)
from planner.service.links.warming import warm
from vehicle.trials.sheets.catalogue import validate
warm()
validate(("fixed", "zigzag"))
sys.argv = ["headland", "diagnose", *map(str, sorted(here.glob("*.csv"))), "--json"]
main()
"""


def warm() -> None:
    """Compile what most tests need, for ten minutes at most; a fault here is not told, as tests will show it."""
    with tempfile.TemporaryDirectory() as place:
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": place}
        for process in [subprocess.Popen([sys.executable, "-c", code], **silent) for code in (DRIVES, PLANS)]:
            try:
                process.wait(timeout=LONGEST_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
