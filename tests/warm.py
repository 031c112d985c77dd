"""Compiles the simulator once, before tests start that would each compile it at the same time.

Two processes share the work about evenly: one compiles the world, trials, the searches for routes, and what plans with
every strategy need; the other twins, diagnosis, and the search for loads. Neither starts further processes or looks for
garbage, of which compilers leave little. If everything is compiled already they take some seconds. Beside them a third
one collects the tests where none were run before: each worker would rewrite all assertions for itself.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
LONGEST_S = 600.0
UNCOLLECTED = """
import gc
gc.disable()
"""
PLANS = f"""{UNCOLLECTED}
import sys
import numpy as np
import shapely
from fields.geometry.field import Field
from planner.cli.experiments import run_experiments
from planner.cli.main import main
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import build_site
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.worker_tasks import warm_up_simulation
from planner.request.plan_request import PlanRequest
from strategies.moves.drives import measure_settling
from strategies.moves.move_finder import MoveFinder
from strategies.programmes.order_search import OrderProblem, search_programmes
from vehicle.missions.plan import Leg, Mission
from vehicle.model.tractor import Implement, load_tractor
from vehicle.twin.robot_tractor import RobotTractor
warm_up_simulation()
mission = Mission((Leg(np.array([[0.0, 0.0], [9.0, 0.0]]), 1.4),))
RobotTractor(mission, load_tractor("eg105"), Implement()).advance(1.0)
run_experiments(("fixed", "zigzag"))
seconds = np.ones((12, 12))
search_programmes(OrderProblem.from_moves(seconds, seconds[0, :6], seconds[0, :6]), 1, 1)
yard = WorkOrder(PlanRequest(width_m=6.0, tractors=(1,)), Field("yard", shapely.box(0, 0, 90, 60)))
context = prepare_context(yard)
simulate_candidate(context, Candidate("split-field", 2))
site = build_site(context)
finder = MoveFinder(site, measure_settling(site))
finder.has_way_on((10.0, 30.0, 0.0), backwards=False)
finder.search((10.0, 30.0, 0.0), (20.0, 30.0, 3.0))
words = "plan netherlands --width 6 --tractors 1-2 --all --processes 1 --json"
sys.argv = ["headland", *words.split()]
main()
"""
DRIVES = f"""{UNCOLLECTED}
import sys
from pathlib import Path
import numpy as np
from planner.cli.main import main
from planner.fleet.session.fleet_twins import warm_up
from tests.truth.drives import default_programme, three_speeds_programme
from tests.truth.model import make_logs
from tests.truth.second import second_logs
warm_up()
second_logs({{}}, 3, three_speeds_programme()[:1], "mr1000a")
here = Path.cwd()
for number, log in enumerate(make_logs({{"steering_offset": {{"angle_deg": 1.0}}}}, 3, default_programme()[:8])):
    log.to_csv(here / f"{{number}}.csv", index=False)
sys.argv = ["headland", "diagnose", *map(str, sorted(here.glob("*.csv"))), "--json"]
main()
"""


def warm() -> None:
    """Compile what most tests need, for at most ten minutes; faults are ignored here, as tests will show them."""
    with tempfile.TemporaryDirectory() as place:
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        collect = ["-m", "pytest", "--collect-only", "-q", "-n", "0", "-m", ""]
        is_new = not sys.dont_write_bytecode and not any(HERE.glob("*/__pycache__/test_*pytest*"))
        jobs = [(["-c", DRIVES], place), (["-c", PLANS], place), *([(collect, HERE.parent)] if is_new else [])]
        for process in [subprocess.Popen([sys.executable, *words], cwd=folder, **silent) for words, folder in jobs]:
            try:
                process.wait(timeout=LONGEST_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
